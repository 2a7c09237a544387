"""The samples and edges of pixels where edges crowd, as far as derivatives need them.

Each such pixel is a block of finer samples with a ring of samples around it. Where two blocks
touch, each has a row of the other's samples in its ring, and the pairs across the border are in
both. What is in both is traced once; each block takes the part in its own pixel.

Edges between finer samples are told from the samples alone (`between.py`), and the interior term is
that of every other sample, as on the squares of one colour of a chessboard (`representation.py`).
"""

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import ad

from ..core.arrays import Array
from ..core.host import chunks, stacked, to_lanes, to_numpy
from ..sampling.band import Band
from ..tracing.record import MOST_NODES, Record
from . import kernels, settings
from .between import Between
from .contrast import Grid, contrasts
from .correction import Met, MovingPoints, Traced
from .pairs import walk_order
from .quadrature import Extra
from .refinement import crowd_side_of, summed
from .slopes import Line
from .tables import deposit


def coarse_blocks(band: Band, pixels: np.ndarray) -> list["Block"]:
    """Begin to trace the pixels where edges crowd, with half as many samples along a side as the
    image has there, but at least `settings.COARSE_SIDE`.
    """
    return _blocks(band, pixels, coarse_side(band))


def coarse_side(band: Band) -> int:
    """Samples along the side of a pixel where edges crowd, in derivatives."""
    side = crowd_side_of(band)
    return min(max(side // 2, settings.COARSE_SIDE), side)


def block_means(coarse: list["Block"], dtype: Any) -> np.ndarray:
    """The pixels' radiance: (N, 3). Sums are in the order of `crowd_means`."""
    return np.concatenate([np.zeros((0, 3), dtype), *(block.means() for block in coarse)])


def with_finer(coarse: list["Block"]) -> Iterator["Block"]:
    """The blocks with those that are busy taken out, and sampled as finely as the image is."""
    for block in coarse:
        side, finer = crowd_side_of(block.band), []
        block.find_pairs()
        if block.side < side:
            finer = _blocks(block.band, block.drop_busy(), side)
        if block.kept.any():
            yield block
        for block in finer:
            block.find_pairs()
            yield block


def _blocks(band: Band, pixels: np.ndarray, side: int) -> list["Block"]:
    """As many blocks at once as a kernel takes."""
    parts = chunks(len(pixels), settings.SAMPLES // (side + 2) ** 2)
    return [Block(band, pixels[part], side) for part in parts]


class Block:
    """Some pixels where edges crowd.

    Samples have places in (blocks, rows, columns); rows and columns include the ring. The corners
    of the ring stand for the samples next to them inside.
    """

    def __init__(self, band: Band, pixels: np.ndarray, side: int) -> None:
        self.band, self.pixels, self.side = band, pixels, side
        ring = ((np.arange(-1, side + 1) + 0.5) / side).astype(band.dtype)
        columns, self.shape = band.resolution[0], (len(pixels), side + 2, side + 2)
        x = (pixels % columns).astype(band.dtype)[:, None, None] + ring
        y = (pixels // columns + band.first_row).astype(band.dtype)[:, None, None] + ring[:, None]
        self.x, self.y = (np.broadcast_to(v, self.shape).ravel() for v in (x, y))
        # The pixel of each place; -1 in the ring
        inside = np.pad(np.ones((side, side), bool), 1)
        self.pixel = np.where(inside, pixels.astype(np.int32)[:, None, None], -1).ravel()
        self.inner = self._inner()
        traced, self.number = self._traced()
        place = band.lanes(self.x.take(traced), self.y.take(traced))
        self.record = self._record(dr.width(place))
        bright = dr.opaque(ad.Bool, True)
        found = kernels.labelled_samples(*band.inputs, *place, bright, self.record)
        self.color, self.label = found
        self.kept = np.ones(len(pixels), bool)
        self.pairs: tuple[np.ndarray, ...] = ()

    def _record(self, samples: int) -> Record | None:
        """What the samples will meet, where it is kept."""
        structure, nodes = self.band.structure, self.band.nodes
        fits = structure.recorded and samples * nodes <= MOST_NODES
        return Record.of(structure.precision, samples, nodes) if fits else None

    def _inner(self) -> np.ndarray:
        """For each place in a ring, the place of the same sample inside of another block; where no
        block has it, and inside of blocks, the place itself.
        """
        band, pixels = self.band, self.pixels
        block = np.full(band.rows * band.resolution[0], -1)
        block[pixels] = np.arange(len(pixels))
        row, column = np.divmod(pixels, band.resolution[0])
        last, below = band.resolution[0] - 1, band.resolution[0]
        place = np.arange(len(self.x)).reshape(self.shape)
        inner = place.copy()
        for row_of, beside in ((0, 1), (-1, -2)):
            inner[:, row_of, 0], inner[:, row_of, -1] = place[:, beside, 1], place[:, beside, -2]
        for legal, step, ring, inside in (
            (column > 0, -1, np.s_[1:-1, 0], np.s_[1:-1, -2]),
            (column < last, 1, np.s_[1:-1, -1], np.s_[1:-1, 1]),
            (row > 0, -below, np.s_[0, 1:-1], np.s_[-2, 1:-1]),
            (row < band.rows - 1, below, np.s_[-1, 1:-1], np.s_[1, 1:-1]),
        ):
            here = np.flatnonzero(legal)
            there = block[pixels[here] + step]
            here, there = here[there >= 0], there[there >= 0]
            inner[(here, *ring)] = place[(there, *inside)]
        return inner.ravel()

    def _traced(self) -> tuple[np.ndarray, np.ndarray]:
        """The places of the samples to trace, and for each place the number among them."""
        traced = np.flatnonzero(self.inner == np.arange(len(self.x)))
        number = np.zeros(len(self.x), np.uint32)
        number[traced] = np.arange(len(traced))
        return traced, number.take(self.inner)

    def drop_busy(self) -> np.ndarray:
        """Drop the pixels that have many strong edges, and return them."""
        a, _, contrast = self.pairs
        block = a // (self.shape[1] * self.shape[2])
        total = np.bincount(block, contrast, len(self.pixels))
        self.kept = total < settings.BUSY * self.side
        here = np.flatnonzero(self.kept.take(block))
        self.pairs = tuple(column.take(here) for column in self.pairs)
        return self.pixels[~self.kept]

    def samples_and_edges(self, edges: list[MovingPoints]) -> Traced:
        """The samples of the interior term; the edges are added to a list."""
        # Kernels run while their successors' inputs are made
        place, part = self._parts()
        found = [(*pairs, *self._between(*pairs[:2])) for pairs in self._in_order()]
        taken = np.zeros(len(self.x), self.band.dtype)
        edges += [self._edges(*own, taken) for own in found]
        samples = self._samples(place, part, taken)
        return Traced(samples, self.number.take(place), self.record)

    @cached_property
    def labels(self) -> np.ndarray:
        """The label at each place."""
        return self.label.numpy().take(self.number)

    def means(self) -> np.ndarray:
        """The pixels' radiance: (N, 3)."""
        color = stacked(to_numpy(self.color), self.number).reshape(3, *self.shape)
        mean: np.ndarray = summed(summed(color[..., 1:-1, 1:-1])).T / self.side**2
        return mean

    def find_pairs(self) -> None:
        """Find neighbours across edges that matter: their places, and their contrast."""
        blocks, row, column = self.shape
        square = row * column
        first = np.arange(blocks, dtype=np.uint32) * np.uint32(square)
        in_row, in_square, in_all = (dr.opaque(ad.UInt32, n) for n in (column, square, len(self.x)))
        grid = Grid(in_row, in_square, in_all, to_lanes(first))
        found = contrasts(grid, to_lanes(self.number), self.color, self.label)
        ways = [(own.numpy(), step) for own, step in zip(found, (1, column), strict=True)]
        ends = [(np.flatnonzero(contrast), step) for contrast, step in ways]
        a = np.concatenate([place for place, _ in ends])
        b = np.concatenate([place + step for place, step in ends])
        seen = [own.take(place) for (own, _), (place, _) in zip(ways, ends, strict=True)]
        self.pairs = a, b, np.concatenate(seen)

    def _in_order(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """The places a and b of neighbours, those across the same edge together; and (2, N), the
        place of a in the block that has it inside, and in one that has it in its ring, or -1.
        """
        a, b, places = self._once()
        ends = (self._order(self.labels.take(place)) for place in (a, b))
        order = np.argsort(sum(ends), kind="stable")
        for part in chunks(len(a), settings.LANES):
            yield a.take(order[part]), b.take(order[part]), places.take(order[part], 1)

    def _once(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`_in_order`, in another order."""
        a, b, _ = self.pairs
        in_ring = self.pixel.take(a) < 0
        own, other = np.flatnonzero(~in_ring), np.flatnonzero(in_ring)
        # By direction and place, where a pair is in the list, counted from 1. One whose a is in the
        # ring looks for the same pair in the block that has a inside
        key = np.where(b - a > 1, len(self.x), 0)
        listed = np.zeros(2 * len(self.x), np.int32)
        listed[(key + a).take(own)] = 1 + own
        ring = a.take(other)
        same = listed.take(key.take(other) + self.inner.take(ring)) - 1
        found = same >= 0
        in_other = np.full(len(a), -1)
        in_other[same[found]] = ring[found]
        rest = ring[~found]
        first = np.concatenate([a.take(own), rest])
        second = np.concatenate([b.take(own), b.take(other[~found])])
        owner = np.concatenate([a.take(own), np.full(rest.size, -1)])
        return first, second, np.stack([owner, np.concatenate([in_other.take(own), rest])])

    def _order(self, labels: np.ndarray) -> np.ndarray:
        return walk_order(labels, self.band.structure.few_alike)

    def _parts(self) -> tuple[np.ndarray, Array]:
        """The places of the interior term's samples, and how well they stand for their cells."""
        band, places = self.band, np.arange(len(self.x), dtype=np.uint32).reshape(self.shape)
        row, column = np.indices((self.side, self.side))
        place = places[self.kept, 1:-1, 1:-1][:, (row + column) % 2 == 0].ravel()
        below, step = (
            dr.opaque(ad.UInt, self.shape[2]),
            dr.opaque(type(self.color.x), 1 / self.side),
        )
        lanes = band.lanes(self.x.take(place), self.y.take(place), place)
        traced = to_lanes(self.number)
        samples = self.color, self.label, traced, self.record
        return place, kernels.representative(*band.inputs, *lanes, below, step, *samples)

    def _between(self, a: np.ndarray, b: np.ndarray) -> tuple[Between, Met]:
        """The edges between neighbours, and what the first of these have met."""
        length = np.full(len(a), 1 / self.side, self.band.dtype)
        line = Line(*self.band.lanes(self.x.take(a), self.y.take(a), b - a > 1, length))
        ends = self.band.lanes(self.number.take(a), self.number.take(b))
        found = kernels.edges_between(*self.band.inputs, line, *ends, self.record)
        return found, () if self.record is None else (ends[0], self.record)

    def _edges(
        self,
        a: np.ndarray,
        b: np.ndarray,
        places: np.ndarray,
        found: Between,
        met: Met,
        taken: np.ndarray,
    ) -> MovingPoints:
        """The edges between neighbours. What a pixel gets of them has one order in all bands.

        Args:
            places: of `_in_order`.
            found, met: of `_between`.
            taken: of all samples, the part that moves with edges; it is added to.
        """
        share, moved = (
            found.rooted.numpy()[: len(a)],
            stacked(to_numpy(found.change), slice(len(a))),
        )
        pixels, changes = [], []
        for first in places:
            known, second = first >= 0, first + (b - a)
            sample = np.where(share > 0, second, first)
            deposit(taken, np.where(known, sample, -1), settings.ROOTED_PART * np.abs(share))
            # Both samples change the same pixel, as far as they are in it
            ends = np.where(known, self.pixel.take(np.stack([first, second])), -1)
            pixels.append(np.maximum(*ends))
            changes.append((moved * (ends >= 0)).sum(0))
        pixel, change = np.stack(pixels), np.stack(changes)
        edge = vars(found.edge.path) | vars(found.edge.event)
        return MovingPoints(found.x, found.y, pixel, change, found.jump, edge, met)

    def _samples(self, place: np.ndarray, part: Array, taken: np.ndarray) -> Extra:
        """The samples of the interior term.

        Args:
            place, part: of `_parts`.
            taken: of all samples, the part that moves with edges.
        """
        weight = np.maximum(1 - taken.take(place), 0) * part.numpy()[: len(place)]
        weight /= -(-(self.side**2) // 2)
        order = self._order(self.labels.take(place))
        x, y, pixel = self.x.take(place), self.y.take(place), self.pixel.take(place)
        return Extra(x, y, pixel, weight, order)
