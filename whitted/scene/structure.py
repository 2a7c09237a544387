"""What of a scene kernels are compiled for: all but its numbers."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import repeat
from typing import TYPE_CHECKING

from ..core.arrays import Array
from ..core.pytree import put_together, take_apart

if TYPE_CHECKING:
    from .contents import Contents
    from .scene import Scene


class Structure:
    """A scene without its arrays. It can be hashed, so that kernels are recorded by it."""

    def __init__(self, scene: "Contents") -> None:
        self.features = scene.features
        self.precision = scene.precision
        # The rest of the fields is given to kernels in other ways, or not at all
        other = {
            "touched": frozenset(),
            "resolution": (0, 0),
            "max_depth": 0,
            "min_importance": 0.0,
            "text": "",
        }
        compiled = replace(scene, fixed=self.features, **other)  # type: ignore[arg-type]
        self.key = take_apart(compiled, []), self.precision.name
        self._hash = hash(self.key)
        self._locations = scene.locations

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Structure) and self.key == other.key)

    def filled(self, parameters: Mapping[str, Array]) -> "Scene":
        """A scene of this structure with these parameters, which must be all of them."""
        scene: Scene = put_together(self.key[0], repeat(None))
        scene.__dict__["locations"] = self._locations
        return scene.carrying(parameters)
