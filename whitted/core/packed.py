"""Many numbers in one array. A kernel with one input starts sooner than one with a hundred."""

from collections.abc import Iterable, Sequence
from itertools import chain

import drjit as dr
import numpy as np
from drjit.llvm import ad

from .arrays import Array, Parameters, Precision, precision_of
from .host import to_array
from .pytree import Apart


class Layout:
    """The names of numbers and vectors that follow each other, and how many numbers each has."""

    def __init__(self, sizes: Iterable[tuple[str, int]]) -> None:
        self.sizes = tuple(sizes)
        self._hash = hash(self.sizes)

    def some(self, names: Iterable[str]) -> "Layout":
        """The layout of some of the names, as far as it has them."""
        sizes = dict(self.sizes)
        return Layout((name, sizes[name]) for name in names if name in sizes)

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Layout) and self.sizes == other.sizes)


def packed(
    layout: Layout, numbers: Iterable[Sequence[float]], precision: Precision, others: Parameters
) -> Apart:
    """Numbers to be given to many functions. They get arrays of width 1 by name.

    Args:
        numbers: of each name in the layout.
        others: arrays that they get as they are.
    """
    flat = np.fromiter(chain.from_iterable(numbers), precision.dtype)
    return Apart((layout, to_array(flat, len(flat)), others), _made)


def _made(values: tuple[Layout, Array, Parameters]) -> Parameters:
    layout, flat, others = values
    return unpacked(layout, flat) | others


def unpacked(layout: Layout, flat: Array) -> Parameters:
    """Numbers and vectors by name."""
    precision, found, first = precision_of(flat), {}, 0
    for name, size in layout.sizes:
        numbers = [dr.gather(precision.real, flat, ad.UInt32(first + k)) for k in range(size)]
        found[name] = numbers[0] if size == 1 else precision.vector(*numbers)
        first += size
    return found


def joined(values: Parameters, precision: Precision) -> Array:
    """The reverse of `unpacked`: numbers and vectors, in order, in one array."""
    numbers: list[Array] = []
    for value in values.values():
        numbers += list(value) if dr.depth_v(value) == 2 else [value]
    flat = dr.empty(precision.real, len(numbers))
    # Told that each goes to its own place, Dr.Jit takes one kernel for all
    for k, number in enumerate(numbers):
        dr.scatter(flat, number, ad.UInt32(k), mode=dr.ReduceMode.NoConflicts)
    return flat
