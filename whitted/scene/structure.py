"""What of a scene kernels are compiled for: all but its numbers and names."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import repeat
from typing import TYPE_CHECKING, Any

from ..core.arrays import Array
from ..core.packed import Layout
from ..core.pytree import put_together, take_apart
from ..shapes.many import ManySpheres
from .features import Features, can_be_recorded, mirrors, reflects
from .many import OF_MANY, materials_of_many
from .parameters import Location

if TYPE_CHECKING:
    from .contents import Contents
    from .scene import Scene

# A number that no derivative is taken by; kernels take it with the parameters
UP = "camera.up"


class Structure:
    """A scene without its arrays and names. It can be hashed, so that kernels are recorded by it.

    Things are named by their places in the scene instead, and their parameters with them.
    """

    def __init__(self, scene: "Contents") -> None:
        self.features = scene.features
        self.reflects = reflects(scene)
        # How many spheres a tree finds. With some, few trees of rays are equal
        self.in_tree = scene.sources[-1].rows.stop if scene.sources else 0
        self.few_alike = self.in_tree > 0
        # How many balls mirror
        self.mirrors = mirrors(scene)
        # What rays meet there is kept for derivatives
        self.recorded = self.in_tree > 0 and can_be_recorded(scene)
        self.precision = scene.precision
        materials = _places(scene.materials)
        changed: dict[str, Any] = {
            "shapes": tuple(
                replace(shape, name=str(k), material=materials[shape.material])
                for k, shape in enumerate(scene.singles)
            ),
            "clouds": (),
            "many": self._many(scene, materials),
            "materials": _numbered(scene.materials),
            "lights": _numbered(scene.lights),
            # What follows is given to kernels in other ways, or not at all
            "camera": replace(scene.camera, up=None),  # type: ignore[arg-type]
            "touched": frozenset(),
            "resolution": (0, 0),
            "max_depth": 0,
            "min_importance": 0.0,
            "text": "",
            "folder": "",
        }
        # Where parameters are in kernels, and their names there
        places = _locations_in_kernels(scene)
        self.names = {name: _placed(name, where) for name, where in places.items()}
        bare = replace(scene, fixed=self._features(materials), **changed)
        self.key = take_apart(bare, []), self.precision.name, self.mirrors
        self._hash = hash(self.key)
        self._locations = {self.names[name]: where for name, where in places.items()}
        self._locations[UP] = replace(self._locations["camera.look_at"], path=("up",))
        sizes = ((self.names[name], where.entry.size) for name, where in places.items())
        # How kernels get their numbers
        self.layout = Layout([*sizes, (UP, 3)])
        if scene.sources:
            self._locations |= OF_MANY

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Structure) and self.key == other.key)

    def filled(self, inputs: Mapping[str, Array]) -> "Scene":
        """A scene of this structure with these `Contents.inputs`."""
        scene: Scene = put_together(self.key[0], repeat(None))
        scene.__dict__["locations"] = self._locations
        return scene.carrying(inputs)

    def _many(self, scene: "Contents", materials: Mapping[str, str]) -> ManySpheres | None:
        """The spheres that a tree finds, with any arrays."""
        if not scene.sources:
            return None
        names = tuple(materials[name] for name in materials_of_many(scene.sources))
        facts, anything = scene.marked[0], scene.background
        return ManySpheres(names, self.in_tree, facts, *(anything,) * len(OF_MANY))

    def _features(self, materials: Mapping[str, str]) -> Features:
        """The features of the scene, by the names in kernels."""
        features = self.features
        return Features(
            frozenset(self.names[name] for name in features.live),
            frozenset(materials[name] for name in features.coated),
            frozenset(materials[name] for name in features.shadowless),
            features.places,
        )


def _locations_in_kernels(scene: "Contents") -> dict[str, Location]:
    """Where each parameter is in kernels, but for those of the spheres that a tree finds."""
    singles = {f"{own.group}.{own.name}": k for k, own in enumerate(scene.singles)}
    places = {}
    for name, where in scene.locations.items():
        if where.field == "shapes":
            place = singles.get(name.removesuffix(f".{where.path[0]}"))
            if place is not None:
                places[name] = replace(where, place=place)
        elif where.field != "clouds":
            places[name] = where
    return places


def _placed(name: str, where: Location) -> str:
    """A parameter's name with its thing's place for that one's name."""
    if where.place is None:
        return name
    return ".".join((name.partition(".")[0], str(where.place), *where.path))


def _places(things: tuple[Any, ...]) -> dict[str, str]:
    return {thing.name: str(k) for k, thing in enumerate(things)}


def _numbered(things: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(replace(thing, name=str(k)) for k, thing in enumerate(things))
