"""The task of a large picture: render a band of its rows."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.interrupts import held
from ..rendering.samples import render_samples
from ..scene.scene import Scene
from .pyramid import write_band

# Samples of a band, about: enough for more than 50 ms, and little to lose
SAMPLES = 1 << 20


@dataclass(frozen=True)
class Picture:
    """What the tasks of a picture share."""

    scene: Scene
    resolution: tuple[int, int]
    spp: int
    options: dict[str, Any]  # further ones of `render`
    rows: int  # of a band
    store: str | None = None  # where workers write their bands to, in place of giving them back

    def band(self, task: int) -> tuple[int, int]:
        """The first row of a task's band, and how many it has."""
        first = task * self.rows
        return first, min(self.rows, self.resolution[1] - first)

    @property
    def tasks(self) -> int:
        return -(-self.resolution[1] // self.rows)


def rows_of_band(resolution: tuple[int, int], spp: int, multiple: int) -> int:
    """How many rows a band has: a multiple of a number, unless the picture is lower.

    Args:
        multiple: the rows of a tile, or of a chunk.
    """
    width, height = resolution
    tiles = max(1, SAMPLES // (width * spp * multiple))
    return min(tiles * multiple, height)


def render_band(picture: Picture, task: int) -> np.ndarray | None:
    """A band's pixels, (rows, width, 3); None if they are in the store."""
    first, count = picture.band(task)
    pixels: np.ndarray = render_samples(
        picture.scene,
        picture.spp,
        resolution=picture.resolution,
        rows=(first, count),
        **picture.options,
    ).numpy()
    if picture.store is None:
        return pixels
    # Ctrl-C within zarr would leave tasks of its own behind
    held(write_band, picture.store, first, pixels)
    return None
