"""A band of an image's rows, and the first inputs of the kernels that work on it."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..core.arrays import Array
from ..core.host import to_lanes
from ..core.pytree import Apart
from ..scene.structure import Structure
from ..tracing.node import Limits
from .film import Film, film_of

# Inputs of a kernel at points
Inputs = tuple[Structure, Apart, Array, Limits]


@dataclass(frozen=True)
class Band:
    """Some rows of an image."""

    structure: Structure
    parameters: Apart  # name to array
    limits: Limits
    resolution: tuple[int, int]  # of the whole image
    first_row: int
    rows: int
    side: int  # samples along a pixel's side

    @property
    def dtype(self) -> Any:
        """NumPy's type for real numbers."""
        return self.structure.precision.dtype

    def film(self, margin: int = 0) -> Film:
        """The band's film, with a margin of some pixels around it."""
        precision = self.structure.precision
        return film_of(self.resolution, self.first_row, self.rows, self.side, precision, margin)

    @cached_property
    def nodes(self) -> int:
        """Nodes of a sample's chain of rays, at most."""
        return int(self.limits.depth.numpy()[0]) if self.structure.reflects else 1

    @cached_property
    def inner(self) -> Film:
        """The film without a margin."""
        return self.film()

    @cached_property
    def finer(self) -> Film:
        """The film with four times the samples."""
        return replace(self, side=2 * self.side).film()

    @property
    def inputs(self) -> Inputs:
        """The first inputs of all kernels at points."""
        return self.structure, self.parameters, self.inner.size, self.limits

    def lanes(self, *arrays: np.ndarray) -> list[Array]:
        """Dr.Jit arrays of whole packets; real numbers in the band's precision.

        Those that are Dr.Jit arrays already stay as they are.
        """
        real = {"f": self.dtype}

        def lanes(x: Any) -> Array:
            if not isinstance(x, np.ndarray):
                return x
            return to_lanes(x.astype(real.get(x.dtype.kind, x.dtype), copy=False))

        return [lanes(x) for x in arrays]

    def color(self, channels: np.ndarray) -> Array:
        """The lanes of colours of shape (3, N)."""
        return self.structure.precision.vector(*self.lanes(*channels))
