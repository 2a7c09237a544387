"""A band of an image's rows, and the way between NumPy's arrays and those of the kernels that work on it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, is_dataclass, replace
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import ad

from .film import Film, band
from .geometry import Array
from .scene import Shape
from .trace import Limits

# Most lanes of one call of a kernel: those of derivatives keep all parameters' derivatives for each lane
SAMPLES = 1 << 20
LANES = 1 << 17
PACKET = 16
# Hands to which packets are dealt out: threads get some each
HANDS = 16
# Edges that weigh less in a pixel, for one sample a pixel, are left to the samples
FAINT = 1 / 8
# The least weight of a ray of a sample beside an edge, for one sample a pixel
DIM = 1 / 32


@dataclass(frozen=True)
class Band:
    """Some rows of an image."""

    shape: Shape
    parameters: dict[str, Array]
    limits: Limits
    resolution: tuple[int, int]  # of the whole image
    first_row: int
    rows: int
    side: int  # samples along a pixel's side

    @property
    def real(self) -> type:
        return type(self.shape.scene.camera.fov)

    def film(self, margin: int) -> Film:
        return band(self.resolution, self.first_row, self.rows, self.side, self.real, margin)

    @cached_property
    def inner(self) -> Film:
        """The film without a margin."""
        return self.film(0)

    @cached_property
    def finer(self) -> Film:
        """The film without a margin, with four samples for each."""
        return replace(self, side=2 * self.side).film(0)

    @property
    def inputs(self) -> tuple[Shape, dict[str, Array], Array, Limits]:
        """What all kernels of `probe` take first."""
        return self.shape, self.parameters, self.inner.size, self.limits

    def leaving_out_dim(self, which: np.ndarray) -> tuple[Shape, dict[str, Array], Array, Limits]:
        """The same, for samples of which some, that count for a part of a pixel, are to have no rays of little weight."""
        least = self.shape.scene.min_importance
        importance = np.where(which, max(least, DIM / self.side**2), least)
        return *self.inputs[:-1], replace(self.limits, importance=self.lanes(importance)[0])

    def lanes(self, *arrays: np.ndarray) -> list[Array]:
        """Dr.Jit arrays of whole packets."""
        real = number(self.real)
        return [lanes(array.astype(real, copy=False) if array.dtype.kind == "f" else array) for array in arrays]

    def color(self, channels: np.ndarray) -> Array:
        return type(self.shape.scene.background)(*self.lanes(*channels))


def number(real: type) -> Any:
    """NumPy's type for a Dr.Jit type of numbers."""
    return np.float32 if real is ad.Float else np.float64


KINDS = {np.dtype(a): b for a, b in ((bool, ad.Bool), ("f4", ad.Float), ("f8", ad.Float64), ("u4", ad.UInt), ("u8", ad.UInt64))}


def lanes(array: np.ndarray) -> Array:
    """A Dr.Jit array of whole packets, as kernels want more than one lane; zeros fill the last one up."""
    return aligned(array, -(-len(array) // PACKET) * PACKET)


def aligned(array: np.ndarray, length: int) -> Array:
    """A Dr.Jit array in Dr.Jit's memory, as one in NumPy's, of another alignment, would get a kernel of its own."""
    result: Array = dr.empty(KINDS[array.dtype], length)
    memory = result.numpy()
    memory[: len(array)], memory[len(array) :] = array, 0
    return result


def dealt(order: np.ndarray) -> np.ndarray:
    """Lanes, of which neighbours do like work, with packets dealt out to hands in turn: threads get equal shares."""
    whole = len(order) // (HANDS * PACKET) * HANDS * PACKET
    return np.concatenate([order[:whole].reshape(-1, HANDS, PACKET).swapaxes(0, 1).ravel(), order[whole:]])


def fetched(value: Any) -> Any:
    """Dr.Jit's arrays, those in dataclasses too, as NumPy's: a tuple of its components for a vector. Waits for all kernels."""
    if is_dataclass(value) and not isinstance(value, type):
        return type(value)(**{name: fetched(part) for name, part in vars(value).items()})
    return value.numpy() if dr.depth_v(value) == 1 else tuple(component.numpy() for component in value)


def rows(components: Sequence[np.ndarray], which: slice | np.ndarray) -> np.ndarray:
    """Some elements of a vector, shape (components, elements)."""
    return np.stack([component[which] for component in components])


def chunks(n: int, size: int) -> Iterator[slice]:
    for first in range(0, n, size):
        yield slice(first, min(first + size, n))
