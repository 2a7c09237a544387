"""The contrasts of neighbouring samples across edges, in pixels where edges crowd."""

from dataclasses import dataclass

import drjit as dr
from drjit.llvm import ad

from ..core.arrays import Array
from ..core.frozen import frozen
from . import settings
from .labels import labels_differ


@dataclass(frozen=True)
class Grid:
    """Squares of samples with a ring around each. Places count row by row, square after square."""

    row: Array  # UInt32: places in a row
    square: Array  # places in a square
    count: Array  # of all places
    first: Array  # the first place of each square


@frozen
def contrasts(grid: Grid, number: Array, color: Array, label: Array) -> tuple[Array, Array]:
    """For each place, the contrast with the next one to the right, and with the one below.

    It is the greatest change of a channel, as a part of the greatest radiance in the square. It is
    0 where no edge is in between, where the edge is too faint to matter, and between two samples of
    the ring.

    Args:
        number: for each place, the number of its sample among those that were traced.
        color, label: of these samples.
    """

    def brightest(k, most):
        here = dr.gather(type(number), number, grid.first + k)
        return k + 1, dr.fmax(most, dr.max(dr.gather(type(color), color, here)))

    start = dr.zeros(ad.UInt32, dr.width(grid.first)), dr.zeros(dr.value_t(color))
    most = dr.while_loop(start, lambda k, _: k < grid.square, brightest, mode="symbolic")[1]
    dr.eval(most)

    place = dr.arange(ad.UInt32, dr.width(number))
    here = place < grid.count
    square = _quotient(place, grid.square)
    row = _quotient(place - square * grid.square, grid.row)
    column = place - square * grid.square - row * grid.row
    last = grid.row - 1
    across = here & (row > 0) & (row < last) & (column < last)
    down = here & (column > 0) & (column < last) & (row < last)

    def sample(where, active):
        which = dr.gather(type(number), number, where, active)
        return (dr.gather(type(of), of, which, active) for of in (color, label))

    own_color, own_label = sample(place, here)
    scale = dr.gather(type(most), most, square, here)

    def contrast(other, active):
        other_color, other_label = sample(other, active)
        change = dr.max(dr.abs(own_color - other_color))
        ratio = dr.select(change > 0, change / scale, 0)
        seen = active & labels_differ(own_label, other_label) & (ratio > settings.LEAST_CONTRAST)
        return dr.select(seen, ratio, 0)

    return contrast(place + 1, across), contrast(place + grid.row, down)


def _quotient(a: Array, b: Array) -> Array:
    """a // b, which is exact in floats for a below 2^23."""
    return ad.UInt32((ad.Float(a) + 0.5) / ad.Float(b))
