"""The bookkeeping of edges on a grid of samples: which samples are neighbours across one, and what it moves where.

All in NumPy, on the few samples that are concerned, and in an order that does not depend on threads. A band's pixels
are numbered row by row; image positions and lengths are in pixels. The last axis of a table's columns counts its rows,
as NumPy is slow on a short last axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np

from .crossing import SLIGHT
from .decisions import differ
from .quadrature import Stretch, nodes

Table = TypeVar("Table")


def take(table: Table, which: np.ndarray) -> Table:
    """Some rows of a dataclass of arrays, by number."""
    return type(table)(*(column.take(which, -1) for column in vars(table).values()))


def joined(tables: Sequence[Table]) -> Table:
    """The rows of several dataclasses of arrays."""
    columns = zip(*(vars(table).values() for table in tables), strict=True)
    return type(tables[0])(*(np.concatenate(column, -1) for column in columns))


@dataclass(frozen=True)
class Samples:
    """Samples on one or more grids of the same shape; what is not in that shape has one row for each sample."""

    labels: np.ndarray  # (grids, rows, columns)
    x: np.ndarray  # image position
    y: np.ndarray
    pixel: np.ndarray  # that a sample counts for; -1 in the margin, where that belongs to a grid to the left or above -2
    twin: np.ndarray | None  # the place of the sample at the same position that counts for a pixel, where there are such
    side: int  # samples along a pixel's side
    first: int  # number of the first sample
    top: int  # to be added to y

    def counted(self, place: np.ndarray) -> np.ndarray:
        """The places of the samples that stand for those at some places."""
        return place if self.twin is None else self.twin.take(place)


@dataclass(frozen=True)
class Pairs:
    """Neighbouring samples with different labels; `a` is to the left of `b`, or above it."""

    x: np.ndarray  # image position of a
    y: np.ndarray
    vertical: np.ndarray  # bool
    length: np.ndarray  # from a to b, in pixels
    sample: np.ndarray  # (2, N): numbers of a and b
    label: np.ndarray  # (2, N)
    order: np.ndarray  # (2, N), of `walk_order`
    pixel: np.ndarray  # (2, N): the pixels that a and b belong to, -1 where those are not to be corrected

    def __len__(self) -> int:
        return len(self.x)

    def ends(self, which: np.ndarray) -> np.ndarray:
        """(2, N): one number for the sample a of some pairs and their direction, and one for b's."""
        return self.sample.take(which, 1) * 2 + self.vertical.take(which)


def band_samples(labels: np.ndarray, side: int, first_row: int) -> Samples:
    """The samples of a band with a margin of one pixel, row by row."""
    return Samples(labels[None], *_band_grid(labels.shape, side), None, side, 0, first_row)


@lru_cache(maxsize=2)
def _band_grid(shape: tuple[int, int], side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each sample of a band with a margin its position and its pixel."""
    rows, columns = shape[0] // side - 2, shape[1] // side - 2
    j, i = np.divmod(np.arange(shape[0] * shape[1]), shape[1])
    x, y = i // side - 1, j // side - 1
    pixel = np.where((x >= 0) & (y >= 0) & (x < columns) & (y < rows), y * columns + x, -1)
    return (i + 0.5) / side - 1, (j + 0.5) / side - 1, pixel.astype(np.int32)


def fine_samples(pixels: np.ndarray, side: int, columns: int, first_row: int) -> tuple[Samples, np.ndarray]:
    """side * side samples in each of a band's pixels, which are in order, and a ring of samples around it.

    Returns:
        The samples without their labels, and the places of those to be traced: in a ring, corners have no use, and what lies
        in another one of the pixels is traced there.
    """
    column, row = pixels % columns, pixels // columns
    grid, x, y, corners, inside = _ring(side)
    x = ((column * side)[:, None] + x) / side
    y = (((row + first_row) * side)[:, None] + y) / side
    pixel, traced = np.where(inside, pixels[:, None], -1), np.ones(x.shape, bool)
    traced[:, corners] = False
    twin = np.arange(pixel.size).reshape(pixel.shape)

    # What rings share with the pixel to the right or below
    right = np.flatnonzero((np.diff(pixels) == 1) & (column[1:] > 0))
    below = np.searchsorted(pixels[:-1], pixels + columns)
    above = np.flatnonzero(pixels.take(below) == pixels + columns)
    for a, b, across in ((right, right + 1, grid.T), (above, below[above], grid)):
        out, last, first, back = across[[-1, -2, 1, 0], 1:-1]
        of_a, of_b = (a[:, None], out), (b[:, None], back)
        twin[of_a], twin[of_b] = b[:, None] * grid.size + first, a[:, None] * grid.size + last
        traced[of_a] = traced[of_b] = False
        pixel[of_b] = -2
    labels = np.empty((len(pixels), *grid.shape), np.uint32)
    return Samples(labels, x.ravel(), y.ravel(), pixel.ravel(), twin.ravel(), side, 0, 0), np.flatnonzero(traced)


@lru_cache
def _ring(side: int) -> tuple[np.ndarray, ...]:
    """The places of side * side samples and a ring around them, in rows; each one's column and row, from the first inside
    and at its center; the places of corners, and whether each one is inside."""
    ring = np.arange(-1, side + 1)
    grid = np.arange(ring.size**2).reshape(ring.size, ring.size)
    inside = np.zeros(grid.shape, bool)
    inside[1:-1, 1:-1] = True
    row, column = np.meshgrid(ring + 0.5, ring + 0.5, indexing="ij")
    return grid, column.ravel(), row.ravel(), grid[[0, 0, -1, -1], [0, -1, 0, -1]], inside.ravel()


def flips(samples: Samples) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of neighbours a and b with different labels, and (2, N) their pixels, of which one at least is not -1."""
    labels, columns = samples.labels.ravel(), samples.labels.shape[2]
    places = [(np.flatnonzero(labels[step:] != labels[:-step]), step) for step in (1, columns)]
    a, b = (np.concatenate(column) for column in zip(*((a, a + step) for a, step in places), strict=True))
    if labels.itemsize == 8:
        kept = np.flatnonzero(differ(labels.take(a), labels.take(b)))
        a, b = a.take(kept), b.take(kept)
    ends = samples.pixel.take(np.stack([a, b]))
    # Not those in the margin, among which are those from the end of a row to the next one's start
    kept = np.flatnonzero((np.maximum(*ends) >= 0) & (ends[0] >= -1))
    a, b, ends = a.take(kept), b.take(kept), ends.take(kept, 1)
    if samples.twin is not None:
        ends[1] = samples.pixel.take(samples.counted(b))
    return a, b, ends


def crowded(ends: np.ndarray, side: int) -> np.ndarray:
    """The pixels among those of neighbours with different labels, of a band with so many samples a side, around which
    three labels may be."""
    touched = np.sort(ends, None)
    touched = touched[np.searchsorted(touched, 0) :]
    again = np.diff(touched, prepend=-1) == 0
    # A single sample has another neighbour on each side; of several all may be on the same side
    return touched.take(np.flatnonzero(again[1:] > again[:-1]) + 1 if side == 1 else np.flatnonzero(~again))


def label_counts(samples: Samples, pixels: np.ndarray) -> np.ndarray:
    """How many labels the samples of a band's pixel and its neighbours' nearest have."""
    side, stride = samples.side, samples.labels.shape[2]
    columns = stride // side - 2
    start = (pixels // columns + 1) * side * stride + (pixels % columns + 1) * side
    labels = samples.labels.ravel().take(start + _window(side, stride)[:, None])
    halves = [labels] if labels.itemsize == 4 else [labels.astype(np.uint32), (labels >> 32).astype(np.uint32)]
    distinct = [_distinct(half) for half in halves]
    return np.minimum(distinct[0], distinct[-1])


def _distinct(labels: np.ndarray) -> np.ndarray:
    """How many different labels each column has."""
    if len(labels) == 5:
        # Of so few, comparing all is faster than sorting
        new = [~np.logical_or.reduce(labels[:k] == labels[k], 0) for k in range(1, 5)]
        return 1 + np.add.reduce(new, 0, dtype=np.uint16)
    ordered = np.sort(labels, 0)
    return 1 + np.add.reduce(ordered[1:] != ordered[:-1], 0, dtype=np.uint16)


@lru_cache
def _window(side: int, stride: int) -> np.ndarray:
    """Places of a pixel's samples and its neighbours' nearest, from the pixel's first sample, in rows of `stride` samples."""
    across, inner = np.meshgrid(np.arange(-1, side + 1), np.arange(side))
    return np.unique(np.concatenate([inner * stride + across, across * stride + inner]))


def pairs_of(samples: Samples, a: np.ndarray, b: np.ndarray, ends: np.ndarray) -> Pairs:
    """Neighbours with different labels, those across the same edge together."""
    label = samples.labels.ravel().take(np.stack([a, b]))
    walks = walk_order(label)
    order = np.argsort(walks[0] + walks[1], kind="stable")
    a, b = a.take(order), b.take(order)
    sample = samples.counted(np.stack([a, b])) + samples.first
    x, y = samples.x.take(a), samples.y.take(a) + samples.top
    length = np.full(len(a), 1 / samples.side)
    return Pairs(x, y, b - a > 1, length, sample, label.take(order, 1), walks.take(order, 1), ends.take(order, 1))


def walk_order(labels: np.ndarray) -> np.ndarray:
    """Where walks through trees of rays come: equal trees together. Sixteen bits, which NumPy sorts in linear time."""
    return labels.astype(np.uint16)


@dataclass(frozen=True)
class Moves:
    """What edges move between the pixels of pairs."""

    pixel: np.ndarray  # (2, N)
    moved: np.ndarray  # (2, N), in units of the jump
    jump: np.ndarray  # (3, N)


@dataclass(frozen=True)
class Crossings:
    """Edges that cross pairs."""

    pair: np.ndarray  # the pair's number
    along: np.ndarray  # distance from a
    jump: np.ndarray  # (3, N): radiance before the edge less that behind it
    change: np.ndarray  # (2, N): how much more of it the cells of a and of b have as the level function grows
    weight: np.ndarray  # the share of the edge that pairs of this direction account for
    singular: np.ndarray  # bool: near the edge radiance changes like the square root of the distance, or faster
    behind: np.ndarray  # bool: it does so behind the edge, not before it

    def __len__(self) -> int:
        return len(self.pair)


def stretches(crossings: Crossings, pairs: Pairs, ends: np.ndarray) -> tuple[Stretch, np.ndarray, np.ndarray]:
    """The lines to sample anew, which are those of pairs with a singular edge.

    A stretch goes halfway to the next crossing, or to the end of a sample's cell.

    Args:
        ends: those of all pairs with a singular edge (`Pairs.ends`).

    Returns:
        The stretches, each one's pair, and (2, N) what they take away from the samples a and b, as parts of those.
    """
    singular = np.zeros(len(pairs), bool)
    singular[crossings.pair[crossings.singular]] = True
    found = take(crossings, np.flatnonzero(singular[crossings.pair]))
    # By pair, then by distance, which is less than a pixel
    found = take(found, np.argsort(found.pair + found.along / 2, kind="stable"))
    pair, c = found.pair, found.along
    here = take(pairs, pair)
    h = here.length
    begins = np.diff(pair, prepend=-1) != 0
    last = np.roll(begins, -1)
    # Where the pair on the other side of a sample has a singular edge as well, each takes half of the sample's cell
    a, b = pairs.ends(pair)
    before = np.where(_marked(ends[1], a), 0, h / 2)
    behind = np.where(_marked(ends[0], b), 0, h / 2)
    # All crossings of a pair share one weight, so that its samples are taken away as a whole. Pairs along an edge take none
    # and those across it all: a part of a sample that is close to the edge would spoil the sum
    first = np.flatnonzero(begins)
    count = np.diff(first, append=len(pair))
    mean = np.add.reduceat(found.weight, first) / count
    share = np.repeat(np.clip((mean - SLIGHT) / (1 - 2 * SLIGHT), 0, 1), count)
    start = np.where(begins, -before, (c + np.roll(c, 1)) / 2)
    stop = np.where(last, h + behind, (c + np.roll(c, -1)) / 2)
    taken = np.stack([np.where(begins, 0.5 + before / h, 0), np.where(last, 0.5 + behind / h, 0)])
    found_here = Stretch(here.x, here.y, here.vertical, h, c, start, stop, found.behind, share * h)
    return found_here, pair, taken * share * (here.pixel >= 0)


def _marked(marks: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Whether each number is among the marks, all of them small (np.isin looks for their range first, which takes longer)."""
    table = np.zeros(1 + max(marks.max(initial=0), numbers.max(initial=0)), bool)
    table[marks] = True
    return table.take(numbers)


@dataclass(frozen=True)
class Extra:
    """Samples in pixels that are sampled anew, and beside singular edges."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray
    weight: np.ndarray  # what the sample counts for in its pixel
    beside: np.ndarray  # bool
    order: np.ndarray  # of `walk_order`


def beside(stretch: Stretch, pieces: int, pixel: np.ndarray, order: np.ndarray) -> Extra:
    """The samples of stretches in pieces, which belong to a pixel and come in the order of (2, N) those of a and b."""
    x, y, weight, in_b, behind = nodes(stretch, pieces)
    pixel, order = np.where(in_b, *pixel[::-1]), np.where(behind, *order[::-1])
    kept = np.flatnonzero((weight > 0) & (pixel >= 0))
    x, y, pixel, weight, order = (column.ravel().take(kept) for column in (x, y, pixel, weight, order))
    return Extra(x, y, pixel, weight, np.ones(len(x), bool), order)


def deposit(image: np.ndarray, pixel: np.ndarray, *channels: np.ndarray) -> None:
    """Add to an image's pixels, in order; pixel -1 takes none.

    Args:
        image: flat, its channels interleaved.
        pixel: any shape.
        channels: the values of each channel, in the shape of `pixel`.
    """
    kept = np.flatnonzero(pixel >= 0)
    # Once here: other integers NumPy would convert for each channel
    place, columns = pixel.take(kept).astype(np.intp), image.reshape(-1, len(channels)).T
    for column, values in zip(columns, channels, strict=True):
        np.add.at(column, place, values.take(kept).astype(image.dtype, copy=False))
