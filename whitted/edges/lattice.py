"""Crowds with one sample a pixel, where all pixels with edges are crowds.

Samples are at the pixels' corners and in the middles of their sides. Pixels share them, so that
with the sample in its middle each pixel has nine, and only three more of them are traced. A
pixel's radiance is the mean of the four squares between its samples, by the trapezoid rule. Edges
are those between neighbours (`between.py`). A side's edges count by half for each of its pixels.

            0  1  2      corner, middle of the upper side, corner
            3  4  5
            6  7  8
"""

from collections.abc import Iterator

import drjit as dr
import numpy as np
from drjit.llvm import ad

from ..core.host import chunks, stacked, to_lanes, to_numpy
from ..sampling.band import Band
from ..tracing.record import MOST_NODES, Record
from . import kernels, settings
from .correction import Met, MovingPoints, Traced
from .lattice_kernels import AROUND, LINES, MIDDLE, contrasts, means, represented
from .quadrature import Extra
from .slopes import Line
from .tables import deposit

# The places of the samples that a pixel does not share with one above or to the left; the others
OWN, OTHERS = (0, 1, 3), (2, 5, 6, 7, 8)
# Among `LINES`: those on a pixel's sides, and Bool: inside of it
SHARED_ABOVE, SHARED_LEFT, SHARED_BELOW, SHARED_RIGHT = (
    slice(first, first + 2) for first in (0, 2, 8, 10)
)
INSIDE = (np.arange(len(LINES)) >= 4) & (np.arange(len(LINES)) < 8)


def shares_samples(band: Band) -> bool:
    """Whether pixels share samples: crowds are everywhere, and a pixel has one sample."""
    return band.side == 1 and kernels.crowds_everywhere(band.structure)


def record_for(band: Band) -> Record | None:
    """A record for all samples that a band may have, where what they meet is kept."""
    structure, columns = band.structure, band.resolution[0]
    samples = band.rows * columns + 3 * (band.rows + 1) * (columns + 1)
    fits = structure.recorded and samples * band.nodes <= MOST_NODES
    return Record.of(structure.precision, samples, band.nodes) if fits else None


def lattices(
    band: Band, pixels: np.ndarray, color: np.ndarray, labels: np.ndarray, record: Record | None
) -> list["Lattice"]:
    """Begin to trace pixels, as many at once as a kernel takes.

    Args:
        pixels: numbers in the band.
        color, labels: of the samples in their middles, (N, 3) and (N,).
        record: of these samples; what others meet is added.
    """
    parts = chunks(len(pixels), settings.SAMPLES // 4)
    return [Lattice(band, pixels[part], color[part], labels[part], record) for part in parts]


class Lattice:
    """Some pixels and their samples.

    In a record, samples in the middles have the numbers of their pixels. Then come those of the
    lattice, three for each of its corners: the corner, and the middles of the sides to its right
    and below it.
    """

    def __init__(
        self,
        band: Band,
        pixels: np.ndarray,
        color: np.ndarray,
        labels: np.ndarray,
        record: Record | None,
    ) -> None:
        self.band, self.pixels, self.record = band, pixels, record
        self.row, self.column = np.divmod(pixels, band.resolution[0])
        # The numbers of the samples around a pixel's middle are that of its first corner and these
        self.first = 3 * (self.row * (band.resolution[0] + 1) + self.column)
        below = 3 * (band.resolution[0] + 1)
        self.offsets = np.array([0, 1, 3, 2, 0, 5, below, below + 1, below + 3])
        self.middle = band.color(color.T), to_lanes(labels)
        traced, slots = self._traced()
        place, bright = band.lanes(*self._place(traced)), dr.opaque(ad.Bool, True)
        number = to_lanes((traced + self._middles).astype(np.uint32))
        self.seen = kernels.labelled_samples(*band.inputs, *place, bright, record, number)
        self.slots = tuple(to_lanes(own.astype(np.uint32)) for own in slots)

    @property
    def _middles(self) -> int:
        """How many numbers in records come before those of the lattice."""
        return self.band.rows * self.band.resolution[0]

    def _traced(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """The numbers of the samples to trace, and for each place around the middle where its
        sample is among them.

        Each pixel begins with its first corner and two sides. Then come the lower and right sides
        of those pixels that have no other below or to the right.
        """
        own = (self.first[:, None] + self.offsets[list(OWN)]).ravel()
        slot = np.full(3 * (self.band.rows + 1) * (self.band.resolution[0] + 1), -1, np.int32)
        slot[own] = np.arange(own.size)
        others = [self.first + self.offsets[place] for place in OTHERS]
        rest = np.unique(np.concatenate([number[slot.take(number) < 0] for number in others]))
        slot[rest] = own.size + np.arange(rest.size)
        slots = dict(zip(OTHERS, (slot.take(number) for number in others), strict=True))
        begin = len(OWN) * np.arange(len(self.pixels))
        slots |= {place: begin + k for k, place in enumerate(OWN)}
        return np.concatenate([own, rest]), [slots[place] for place in AROUND]

    def _place(self, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The image positions of samples of the lattice."""
        corner, kind = np.divmod(number, 3)
        row, column = np.divmod(corner, self.band.resolution[0] + 1)
        return column + 0.5 * (kind == 1), row + self.band.first_row + 0.5 * (kind == 2)

    def means(self) -> np.ndarray:
        """The pixels' radiance: (N, 3)."""
        found = means(*self.middle, *self.seen, self.slots)
        return stacked(to_numpy(found), slice(len(self.pixels))).T

    def samples_and_edges(self, edges: list[MovingPoints]) -> Traced:
        """The samples of the interior term; the edges are added to a list."""
        band, count = self.band, len(self.pixels)
        x, y, number = self.column + 0.5, self.row + band.first_row + 0.5, self.pixels.astype("u4")
        samples = *self.middle, *self.seen, self.slots, to_lanes(number), self.record
        part = represented(*band.inputs, *band.lanes(x, y), *samples)
        # The part of each sample in a middle that moves with edges
        taken = np.zeros(count, band.dtype)
        edges += list(self._edges(taken))
        weight = np.maximum(1 - taken, 0) * part.numpy()[:count]
        order = np.zeros(count, np.uint16)
        extra = Extra(x, y, self.pixels.astype(np.int32), weight, order)
        return Traced(extra, number, self.record)

    def _edges(self, taken: np.ndarray) -> Iterator[MovingPoints]:
        """The edges between neighbours.

        What two pixels share is found by the one below, or to the right. Where that one is not in
        the list, the other pixel finds its part.

        Args:
            taken: of `samples_and_edges`; it is added to.
        """
        count, columns = len(self.pixels), self.band.resolution[0]
        # For each pixel of the band, its place in the list; and one more for those outside
        listed = np.full(self.band.rows * columns + 1, -1)
        listed[self.pixels] = np.arange(count)

        def beside(step: int, legal: np.ndarray) -> np.ndarray:
            """The pixel so many numbers further on, or -1 if it is not in the list."""
            other = np.where(legal, self.pixels + step, -1)
            return np.where(listed.take(other) >= 0, other, -1)

        above, left = beside(-columns, self.row > 0), beside(-1, self.column > 0)
        below = beside(columns, self.row + 1 < self.band.rows)
        right = beside(1, self.column + 1 < columns)
        found = contrasts(*self.middle, *self.seen, self.slots)
        across = np.stack([own.numpy()[:count] > 0 for own in found])
        across[SHARED_BELOW] &= below < 0
        across[SHARED_RIGHT] &= right < 0
        line, place = np.divmod(np.flatnonzero(across), count)
        others = np.full(across.shape, -1)
        others[SHARED_ABOVE], others[SHARED_LEFT] = above, left
        other = others[line, place]
        for part in chunks(len(line), settings.LANES):
            yield self._moving(line[part], place[part], other[part], taken)

    def _moving(
        self, line: np.ndarray, place: np.ndarray, other: np.ndarray, taken: np.ndarray
    ) -> MovingPoints:
        """Edges on lines between neighbours.

        Args:
            line: the number in `LINES`.
            place: where the pixel is in the list.
            other: the pixel that the line is shared with, or -1.
            taken: of `samples_and_edges`; it is added to.
        """
        band, count = self.band, len(line)
        ends = LINES.T.take(line, 1)
        down, right = np.divmod(ends[0], 3)
        x = self.column.take(place) + right / 2
        y = self.row.take(place) + band.first_row + down / 2
        along = Line(*band.lanes(x, y, ends[1] - ends[0] > 1, np.full(count, 0.5)))
        met = band.lanes(*(self._number(own, place) for own in ends))
        found = kernels.edges_between(*band.inputs, along, *met, self.record)

        share = found.rooted.numpy()[:count]
        in_middle = np.where(share > 0, *ends[::-1]) == MIDDLE
        deposit(taken, np.where(in_middle, place, -1), settings.ROOTED_PART * np.abs(share))
        own, last = self.pixels.take(place), line >= SHARED_BELOW.start
        # The pixel above or to the left comes second, whoever has found the edge
        pixel = np.stack([np.where(last, -1, own), np.where(last, own, other)]).astype(np.int32)
        change = stacked(to_numpy(found.change), slice(count)).sum(0)
        change *= np.where(INSIDE[line], 1, 0.5).astype(band.dtype)
        edge = vars(found.edge.path) | vars(found.edge.event)
        known: Met = () if self.record is None else (met[0], self.record)
        changes = np.stack([change, change])
        return MovingPoints(found.x, found.y, pixel, changes, found.jump, edge, known)

    def _number(self, end: np.ndarray, place: np.ndarray) -> np.ndarray:
        """The numbers in records of the samples at the ends of lines."""
        number = self.first.take(place) + self.offsets.take(end) + self._middles
        number = np.where(end == MIDDLE, self.pixels.take(place), number)
        return number.astype(np.uint32)
