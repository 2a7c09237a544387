"""What there is to see: the scene as it is now, what is picked, and how pictures are made."""

import secrets
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..core.arrays import Array
from ..scene.scene import Scene
from .fitting import Event, Fitting
from .history import History
from .messages import Differentiate, Look
from .mouse import Grabbed, place_of, projected, view_of
from .pictures import Wanted, checked_size
from .sliders import sizes_of

# Samples a pixel while nothing moves, unless a page asks for others
SPP = 4


class State:
    """A scene that is looked at and changed. One thread uses it at a time."""

    def __init__(self, scene: Scene, folder: Path, name: str) -> None:
        """Open a scene; the arguments are those of a `Session`.

        Raises:
            ValueError: its pictures are too large to be looked at.
        """
        # Tells a page that comes back whether it is another session
        self.born = secrets.token_hex(8)
        self.scene = scene
        self.history = History(scene)
        self.folder, self.name = folder, name
        # How many numbers each parameter has that pages show; it does not change
        self.sizes = sizes_of(scene)
        # Of a shape or a light, such as "spheres.ball"
        self.picked: str | None = None
        self.held: Grabbed | None = None
        self.asked: Differentiate | None = None
        # Linear RGB of shape (height, width, 3)
        self.target: Array | None = None
        self.fitting: Fitting | None = None
        # Called by the thread of a fit with what it reports
        self.post: Callable[[Event], None] = lambda event: None
        # The next frame shows something else than the last one; it shows something that moves
        self.stale = self.moving = True
        width, height = checked_size(*scene.resolution)
        self.look = Look(
            kind="look",
            size=[width, height],
            spp=SPP,
            edges=True,
            moving_edges=False,
            depth=scene.max_depth,
            outline=True,
            labels=False,
        )

    @property
    def aspect(self) -> float:
        return self.look.size[0] / self.look.size[1]

    def change(self, moving: bool = True) -> None:
        """The next frame shows something else."""
        self.stale, self.moving = True, moving

    def replace(self, values: Mapping[str, Any]) -> None:
        """Give parameters other numbers.

        Raises:
            KeyError, ValueError: as `Scene.replace`.
        """
        if values:
            self.scene = self.scene.replace(values)
            self.change()

    def touch(self, names: list[str]) -> None:
        """Have the next frame compile what these parameters need to move.

        Raises:
            KeyError: there is no such parameter.
        """
        values = self.scene.parameters(*names)
        if not self.scene.touched >= values.keys() & self.scene.neutral.keys():
            self.replace(values)

    def wanted(self) -> Wanted:
        """What the next frame shows; while the mouse moves something, without the difference."""
        target = self.target if self.fitting is not None or not self.moving else None
        if target is not None and list(target.shape[1::-1]) != self.look.size:
            target = None
        picked = self.scene.number_of(self.picked or "")
        return Wanted(self.scene, self.look, picked, self.asked, self.moving, target)

    def lights(self) -> list[dict[str, Any]]:
        """The lights at a point that are in the picture: name, and x and y in parts of it."""
        view, found = view_of(self.scene, self.aspect), []
        for light in self.scene.lights:
            name = f"lights.{light.name}"
            place = place_of(self.scene.numbers, name)
            if place is not None:
                x, y, depth = projected(view, place)
                if depth > 0 and 0 <= x <= 1 and 0 <= y <= 1:
                    found.append({"name": name, "x": x, "y": y})
        return found
