"""What the search for edges found, as far as derivatives need it."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import drjit as dr
import numpy as np

from ..core.arrays import Array
from ..sampling.band import Band
from . import settings
from .blocks import Block, coarse_blocks, with_finer
from .bounds import Cut, places_among
from .correction import Columns, Correction, MovingPoints
from .events import Kind
from .grid import Samples
from .lattice import Lattice
from .motion import Edge
from .pairs import Crossings, Pairs, walk_order
from .quadrature import Extra, Interval, intervals_beside, samples_beside
from .tables import deposit, rows_of


@dataclass(frozen=True)
class Crossed:
    """A chunk of pairs, and the edges that cross them."""

    pairs: Pairs
    crossings: Crossings
    edge: Columns


@dataclass(frozen=True)
class Found:
    """What the search found in a band."""

    band: Band
    refined: np.ndarray  # the pixels whose finer samples were searched, in order
    fine: Samples | None  # their samples
    crowded: np.ndarray  # the pixels where edges crowd, and were not searched
    crossed: list[Crossed]
    lost: np.ndarray  # numbers of samples beside which there are edges that were not found
    cut: Cut
    # Samples of crowds, if the image has taken them
    coarse: list[Block] | None
    lattices: list[Lattice]

    @cached_property
    def correction(self) -> Correction:
        """The correction of the band's pixels.

        It is made when the first derivative asks for it. Kernels of what comes after the image may
        be running meanwhile.
        """
        band, result = self.band, Correction(self.band)
        # Its kernels run while other things are done
        coarse = self.coarse
        if coarse is None:
            coarse = [] if self.lattices else coarse_blocks(band, self.crowded)
        # The part of each sample that edges take away, by the number of the sample
        shape = (band.rows + 2) * band.side, (band.resolution[0] + 2) * band.side
        first = shape[0] * shape[1]
        finer = 0 if self.fine is None else self.fine.pixel.size
        taken = np.zeros(first + finer, band.dtype)
        ends = [np.zeros((2, 0), int)]
        ends += [x.pairs.ends(x.crossings.pair[x.crossings.singular]) for x in self.crossed]
        marked = np.concatenate(ends, 1)
        lines = [self._lines(crossed, marked, taken) for crossed in self.crossed]
        # Each part of a sample is replaced once, where edges of both directions take it
        share = 1 / np.maximum(taken, 1)
        for crossed, (interval, pair) in zip(self.crossed, lines, strict=True):
            result.extra += self._beside(crossed, interval, pair, share)
            result.edges.append(_moving(crossed, self.cut))
        np.minimum(taken, 1, out=taken)
        # The derivative of such a sample lacks that of the edges, which may nearly cancel it
        taken[self.lost] = 1
        if self.fine is not None:
            result.extra.append(_inside(self.fine, 1 - taken[first:]))
        blocks: Iterator[Block | Lattice] = chain(self.lattices, with_finer(coarse))
        for block in blocks:
            result.traced.append(block.samples_and_edges(result.edges))
        result.weights = self._weights(taken[:first].reshape(shape))
        return result

    def _lines(
        self, crossed: Crossed, marked: np.ndarray, taken: np.ndarray
    ) -> tuple[Interval, np.ndarray]:
        """The lines beside edges, and their pairs; the parts of samples that they replace are added
        to `taken`.
        """
        lines, pair, part = intervals_beside(crossed.crossings, crossed.pairs, marked)
        deposit(taken, crossed.pairs.sample.take(pair, 1), part)
        return lines, pair

    def _beside(
        self, crossed: Crossed, lines: Interval, pair: np.ndarray, share: np.ndarray
    ) -> list[Extra]:
        """The samples beside edges."""
        pairs, found = crossed.pairs, crossed.crossings
        # Derivatives may change much between edges that are close to each other, as in curved
        # mirrors, and at singular creases, from which a surface runs off into the distance
        most, close = min(self.band.side, settings.PIECES), np.bincount(found.pair) > 1
        close[found.pair[crossed.edge["kind"] == Kind.CREASE]] = True
        pieces = np.where(close.take(pair), most, 1)
        extra = []
        for count in {1, most}:
            which = np.flatnonzero(pieces == count)
            here = pair.take(which)
            pixel, order = pairs.pixel.take(here, 1), pairs.order.take(here, 1)
            part = share.take(pairs.sample.take(here, 1))
            extra.append(samples_beside(rows_of(lines, which), count, pixel, order, part))
        return extra

    def _weights(self, taken: np.ndarray) -> Array:
        """What the band's regular samples still count for, row by row of samples.

        Args:
            taken: the part of each sample that edges take away, in rows, with the margin.
        """
        side, columns = self.band.side, self.band.resolution[0]
        inner = taken[side:-side, side:-side]
        weights: Array = dr.empty(self.band.structure.precision.real, inner.size)
        regular = weights.numpy().reshape(inner.shape)
        np.subtract(1, inner, out=regular)
        anew = np.concatenate([self.refined, self.crowded])
        rows, places = anew // columns, anew % columns
        regular.reshape(self.band.rows, side, columns, side)[rows, :, places] = 0
        return weights


def _inside(fine: Samples, weight: np.ndarray) -> Extra:
    """The finer samples inside of pixels, as far as edges leave them."""
    inside = np.flatnonzero((fine.pixel >= 0) & (weight != 0))
    order = walk_order(fine.labels.ravel(), fine.few_alike)
    columns = fine.x, fine.y, fine.pixel, weight / fine.side**2
    return rows_of(Extra(*columns, order), inside)


def _moving(crossed: Crossed, cut: Cut) -> MovingPoints:
    """The edges of a chunk as points that move.

    A pixel that was cut off does not follow its edges. The points beside one change one pixel each.
    """
    pairs, found = crossed.pairs, crossed.crossings
    x, y, vertical = (column.take(found.pair) for column in (pairs.x, pairs.y, pairs.vertical))
    pixel = pairs.pixel.take(found.pair, 1)
    x, y = x + np.where(vertical, 0, found.along), y + np.where(vertical, found.along, 0)
    change = found.change * (pixel >= 0)
    points = MovingPoints(x, y, pixel, change, found.jump, crossed.edge)
    pixels, channels = cut
    if not pixels.size:
        return points
    ends = [places_among(pixels, own) for own in pixel]
    beside = ends[0][1] | ends[1][1]
    both, one = np.flatnonzero(~beside), np.flatnonzero(beside)
    points = points.some(np.concatenate([both, one, one]))
    for k, (place, known) in enumerate(ends):
        part = slice(both.size + k * one.size, both.size + (k + 1) * one.size)
        points.pixel[1 - k, part], points.change[1 - k, part] = -1, 0
        # In these channels the pixel was cut off
        points.jump[:, part][known.take(one) & channels[:, place.take(one)]] = 0
    return points


def columns_of(edge: Edge, which: np.ndarray) -> Columns:
    """Some of the edges, with NumPy arrays, by the fields of their paths and events."""
    columns = vars(edge.path) | vars(edge.event)
    return {name: column[which] for name, column in columns.items()}
