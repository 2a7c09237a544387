"""The values of the parameters of each picture of a sweep.

Any part of them is computed by itself, so that a task needs no more than its own, and a sweep that
is resumed has the same ones.
"""

import math
import warnings
from dataclasses import dataclass

import numpy as np

from .libraries import require

SAMPLERS = ("grid", "sobol", "random")
# Binary digits of the points of a Sobol sequence, which has no more than 2^32 of them
BITS = 32


@dataclass(frozen=True)
class Axis:
    """What one number is drawn from."""

    label: str
    low: float = 0.0
    high: float = 0.0
    values: tuple[float, ...] | None = None  # in place of a range

    def at(self, part: np.ndarray) -> np.ndarray:
        """The numbers at parts in [0, 1] of the range."""
        return self.low + (self.high - self.low) * part


@dataclass(frozen=True)
class Samples:
    """The values of all pictures of a sweep."""

    axes: tuple[Axis, ...]
    sampler: str
    count: int
    seed: int

    def values(self, first: int, count: int) -> np.ndarray:
        """The values of some pictures: (count, axes)."""
        index = np.arange(first, first + count)
        if self.sampler == "grid":
            return self._on_grid(index)
        open_axes = [k for k, axis in enumerate(self.axes) if axis.values is None]
        parts = np.zeros((count, len(self.axes)))
        if open_axes:
            draw = self._sobol if self.sampler == "sobol" else self._random
            parts[:, open_axes] = draw(first, count, len(open_axes))
        columns = [
            axis.at(parts[:, k]) if axis.values is None else np.take(axis.values, index)
            for k, axis in enumerate(self.axes)
        ]
        return np.stack(columns, 1)

    def _on_grid(self, index: np.ndarray) -> np.ndarray:
        """On a grid of all combinations, the last number changing fastest."""
        sizes = sides(self.axes, self.count)
        places = np.unravel_index(index, sizes)
        columns = [
            axis.at(place / max(size - 1, 1))
            if axis.values is None
            else np.take(axis.values, place)
            for axis, place, size in zip(self.axes, places, sizes, strict=True)
        ]
        return np.stack(columns, 1)

    def _sobol(self, first: int, count: int, dimensions: int) -> np.ndarray:
        qmc = require("scipy.stats.qmc")
        sequence = qmc.Sobol(dimensions, scramble=True, bits=BITS, rng=self.seed)
        if first:
            sequence.fast_forward(first)
        with warnings.catch_warnings():
            # This is a part of a sequence, whose length need not be a power of two
            warnings.filterwarnings("ignore", "The balance properties of Sobol'")
            drawn: np.ndarray = sequence.random(count)
        return drawn

    def _random(self, first: int, count: int, dimensions: int) -> np.ndarray:
        # Each number takes one step of the generator
        generator = np.random.PCG64(self.seed).advance(first * dimensions)
        return np.random.Generator(generator).random((count, dimensions))


def sides(axes: tuple[Axis, ...], count: int) -> tuple[int, ...]:
    """How many values a grid has along each axis; those of ranges are all as many.

    Raises:
        ValueError: no grid has this number of pictures.
    """
    listed = math.prod(len(axis.values) for axis in axes if axis.values is not None)
    ranges = sum(axis.values is None for axis in axes)
    if not ranges:
        side = 1
        fits = count == listed
        nearest = [listed]
    else:
        side = max(1, round((count / listed) ** (1 / ranges)))
        fits = listed * side**ranges == count
        nearest = [listed * (side + more) ** ranges for more in (0, 1)]
    if not fits:
        choices = " or ".join(map(str, nearest))
        raise ValueError(
            f"count: a grid over {ranges} ranges has a whole number of values along each; "
            f"take {choices} in place of {count}, or another sampler"
        )
    return tuple(len(axis.values) if axis.values is not None else side for axis in axes)
