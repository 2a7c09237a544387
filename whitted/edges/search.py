"""The search for the edges in a band, which corrects the band's pixels."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import drjit as dr
import numpy as np
from drjit.llvm import ad

from ..core.arrays import Array
from ..core.host import chunks, stacked, to_numpy
from ..sampling.band import Band
from ..tracing.record import Record
from . import kernels, settings
from .blocks import Block, block_means, coarse_blocks, coarse_side
from .bounds import Cut, cut_off, numbers_of
from .found import Crossed, Found, columns_of
from .grid import (
    Samples,
    band_samples,
    fine_samples,
    neighbours_across_edges,
    regular_samples,
    samples_inside,
)
from .lattice import Lattice, lattices, record_for, shares_samples
from .locate import Crossing, Segment
from .pairs import Crossings, Moves, Pairs, interleaved, pairs_of
from .refinement import (
    crowd_means,
    crowd_side_of,
    finer_side,
    in_tiles,
    pixels_to_refine,
    searches_crowds,
)
from .tables import concatenated, deposit, rows_of

# The fields of crossings that images do not need
OF_DERIVATIVES = ("change", "weight", "singular", "behind", "edge")
# Called with the fraction done
Report = Callable[[float], None]


def correct(band: Band, keep: bool, report: Report) -> tuple[Array, list[Found]]:
    """A band's pixels, row-major with RGB interleaved, corrected where edges cross them.

    Args:
        keep: also return what the derivatives of the pixels need, for one part of the band after
            the other.
    """
    inputs = band.structure, band.parameters, band.film(margin=1), band.limits
    shared = shares_samples(band)
    record = record_for(band) if keep and shared else None
    flat, *dim, labels = kernels.labelled_image(*inputs, record)
    image, side, width = flat.numpy(), band.side, band.resolution[0]
    grid = labels.numpy().reshape((band.rows + 2) * side, -1)
    few_alike = band.structure.few_alike
    samples = band_samples(grid, side, band.first_row, few_alike)
    neighbours = neighbours_across_edges(samples)
    everywhere = kernels.crowds_everywhere(band.structure)
    anew = pixels_to_refine(samples, neighbours[-1], everywhere)
    searched = keep and searches_crowds(band)
    parts = list(_parts(band, neighbours[-1], *anew, searched))
    found = []
    for done, (first, rows) in enumerate(parts, 1):
        part = band
        if len(parts) > 1:
            part = replace(band, first_row=band.first_row + first, rows=rows)
            own = grid[first * side : (first + rows + 2) * side]
            samples = band_samples(own, side, part.first_row, few_alike)
            neighbours = neighbours_across_edges(samples)
        start, stop = first * width, (first + rows) * width
        meet, crowd = (some[slice(*np.searchsorted(some, (start, stop)))] - start for some in anew)
        crowd = in_tiles(part, crowd)
        pixels = image[start * 3 : stop * 3]
        if searched:
            search = _Search(part, keep, pixels, samples, np.union1d(meet, crowd), crowd[:0])
        else:
            search = _Search(part, keep, pixels, samples, meet, crowd)
        means = search.crowds(record, *(light.numpy()[start * 3 : stop * 3] for light in dim))
        search.run(*neighbours)
        pixels.reshape(-1, 3)[search.crowded] = means()
        if keep:
            found.append(search.found())
        # Parts cost about the same, however many rows they have
        report(done / len(parts))
    return flat, found


def _parts(
    band: Band, ends: np.ndarray, refined: np.ndarray, crowded: np.ndarray, searched: bool
) -> Iterator[tuple[int, int]]:
    """First row and rows of the parts of a band that are searched one after the other.

    What a row costs is told by its pairs of neighbours, and by its pixels that are sampled anew. A
    pair costs as much as sixteen samples where edges crowd.

    Args:
        ends: (2, N), the pixels of neighbours with different labels.
        refined, crowded: the pixels that are sampled anew.
        searched: crowds are searched as well.
    """
    finer, width = finer_side(band.side) ** 2, band.resolution[0]
    dense = finer if searched else crowd_side_of(band) ** 2 // 16
    whole = ends.shape[1] + finer * refined.size + dense * crowded.size <= settings.SEARCHED
    if whole or shares_samples(band):
        yield 0, band.rows
        return
    cost = np.bincount(np.maximum(*ends) // width, minlength=band.rows)
    cost += finer * np.bincount(refined // width, minlength=band.rows)
    cost += dense * np.bincount(crowded // width, minlength=band.rows)
    number = (np.cumsum(cost) - cost) // settings.SEARCHED
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    for first, stop in zip(starts, np.append(starts[1:], band.rows), strict=True):
        yield int(first), int(stop - first)


class _Search:
    """The search for the edges in a part of a band.

    All samples, regular and finer, are numbered in the order in which they are traced.
    """

    def __init__(
        self,
        band: Band,
        keep: bool,
        image: np.ndarray,
        samples: Samples,
        refined: np.ndarray,
        crowded: np.ndarray,
    ) -> None:
        self.band, self.keep, self.image, self.samples = band, keep, image, samples
        self.refined = refined  # the pixels whose finer samples are searched, in order
        self.crowded = crowded  # the pixels that are not searched
        self.fine: Samples | None = None  # their samples
        self.fine_range = np.zeros((2, 3, 0), image.dtype)  # and the range of their radiance
        self.moves: dict[int, list[Moves]] = {}  # by the round of the search
        self.crossed: list[Crossed] = []  # one for each chunk of pairs
        # Single samples beside edges that are not found. With more samples such edges are slight
        self.lost: list[np.ndarray] = [np.zeros(0, np.int64)]
        self.cut: Cut = np.zeros(0, np.int64), np.zeros((3, 0), bool)
        # Samples of crowds, if the image takes them
        self.coarse: list[Block] | None = None
        self.lattices: list[Lattice] = []

    def crowds(
        self, record: Record | None, dim: np.ndarray | None = None
    ) -> Callable[[], np.ndarray]:
        """Begin to trace the pixels that are not searched.

        Args:
            record: of the samples so far, if they are shared.
            dim: the light of dim rays in all pixels, where all with edges are crowds.

        Returns:
            A function that waits for the pixels' radiance: (N, 3).
        """
        band, pixels = self.band, self.crowded
        if dim is None:
            return crowd_means(band, pixels, band.structure.reflects)
        own = dim.reshape(-1, 3).take(pixels, 0)
        if shares_samples(band):
            color = self.image.reshape(-1, 3).take(pixels, 0) - own
            labels = self.samples.labels[0, 1:-1, 1:-1].ravel().take(pixels)
            self.lattices = lattices(band, pixels, color, labels, record)
            return lambda: np.concatenate([own[:0], *(x.means() for x in self.lattices)]) + own
        if self.keep and coarse_side(band) == crowd_side_of(band):
            # The derivatives' samples are those of the image
            self.coarse = coarse_blocks(band, pixels)
            bright: Callable[[], np.ndarray] = partial(block_means, self.coarse, band.dtype)
        else:
            bright = crowd_means(band, pixels, False)
        return lambda: bright() + own

    def run(self, a: np.ndarray, b: np.ndarray, ends: np.ndarray) -> None:
        """Correct the image.

        Args:
            a, b, ends: the neighbours with different labels, and (2, N) their pixels.
        """
        band, samples = self.band, self.samples
        place = self.refined, finer_side(band.side), band.resolution[0], band.first_row
        traced = self.trace(*fine_samples(*place)) if self.refined.size else None

        # Pixels that are sampled anew have pairs of their own
        apart = np.zeros(len(self.image) // 3 + 1, bool)
        apart[self.refined] = apart[self.crowded] = apart[-1] = True
        ends[apart.take(ends)] = -1
        kept = np.flatnonzero(np.maximum(*ends) >= 0)
        pairs = pairs_of(samples, a.take(kept), b.take(kept), ends.take(kept, 1))
        if traced is not None:
            fine = self.refine(*traced)
            pairs = concatenated([pairs, pairs_of(fine, *neighbours_across_edges(fine))])
        for part in chunks(len(pairs), settings.LANES):
            whole = len(pairs) <= settings.LANES
            self.cross(pairs if whole else rows_of(pairs, np.arange(part.start, part.stop)))
        self.move()

    def found(self) -> Found:
        """What the derivatives of the pixels need."""
        lost = np.concatenate(self.lost)
        anew = self.refined, self.fine, self.crowded
        crowds = self.coarse, self.lattices
        return Found(self.band, *anew, self.crossed, lost, self.cut, *crowds)

    def trace(
        self, fine: Samples, places: np.ndarray
    ) -> tuple[Samples, np.ndarray, list[tuple[Array, Array]]]:
        """Begin to trace finer samples: their radiance and labels."""
        x, y = fine.x[places], fine.y[places]
        parts = chunks(len(x), settings.SAMPLES)
        lanes = (self.band.lanes(x[part], y[part]) for part in parts)
        inputs, bright = self.band.inputs, dr.opaque(ad.Bool, False)
        return fine, places, [kernels.labelled_samples(*inputs, *at, bright) for at in lanes]

    def refine(
        self, fine: Samples, places: np.ndarray, traced: list[tuple[Array, Array]]
    ) -> Samples:
        """The finer samples with labels; pixels get the mean of their radiance."""
        colors = np.concatenate([to_numpy(color) for color, _ in traced], 1).T
        labels = np.concatenate([label.numpy() for _, label in traced])
        shape, size, count = fine.labels.shape, fine.labels.size, len(places)
        label, color = np.zeros(size, labels.dtype), np.zeros((size, 3), colors.dtype)
        label[places], color[places] = labels[:count], colors[:count]
        label = label.take(fine.counted(np.arange(size))).reshape(shape)
        inside = color.take(samples_inside(shape), 0)
        self.image.reshape(-1, 3)[self.refined] = inside.mean(0)
        self.fine_range = np.stack([inside.min(0).T, inside.max(0).T])
        samples = self.samples
        self.fine = replace(
            fine, labels=label, first=samples.labels.size, few_alike=samples.few_alike
        )
        return self.fine

    def cross(self, pairs: Pairs) -> None:
        """Find the edges between pairs of samples, and what they move from pixel to pixel."""
        groups, edges = [], []
        for round, (pair, lane, lost, crossing) in enumerate(_rounds(self.band, pairs, self.keep)):
            jump, before = stacked(crossing.jump, lane), stacked(crossing.before, lane)
            move = Moves(pairs.pixel.take(pair, 1), stacked(crossing.moved, lane), jump, before)
            self.moves.setdefault(round, []).append(move)
            if self.keep:
                if self.band.side == 1:
                    self.lost.append(pairs.sample.take(lost, 1).ravel())
                change = stacked(crossing.change, lane)
                moves = np.flatnonzero(change.any(0))
                lane = lane.take(moves)
                found = Crossings(
                    pair=pair.take(moves),
                    along=crossing.along.take(lane),
                    jump=jump.take(moves, 1),
                    change=change.take(moves, 1),
                    weight=crossing.weight.take(lane),
                    singular=crossing.singular.take(lane),
                    behind=crossing.behind.take(lane),
                )
                groups.append(found)
                edges.append(columns_of(crossing.edge, lane))
        if any(groups):
            edge = {name: np.concatenate([edge[name] for edge in edges]) for name in edges[0]}
            self.crossed.append(Crossed(pairs, concatenated(groups), edge))

    def move(self) -> None:
        """Correct the pixels, in an order that does not depend on the chunks."""
        rounds = [concatenated(moves) for moves in self.moves.values()]
        if not rounds:
            return
        every = concatenated(rounds)
        start = numbers_of(self.image, every.pixel.ravel())
        for moves in rounds:
            deposit(self.image, moves.pixel, *(moves.moved * channel for channel in moves.jump))
        self.cut = cut_off(self.image, start, every, self.range_of)

    def range_of(self, pixels: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The least and the greatest radiance of the samples in some pixels, each (3, N)."""
        low, high = start, start.copy()
        again = np.isin(pixels, self.refined, assume_unique=True)
        if again.any():
            own = np.searchsorted(self.refined, pixels[again])
            low[:, again], high[:, again] = self.fine_range.take(own, 2)
        if self.band.side > 1 and not again.all():
            low[:, ~again], high[:, ~again] = self.retraced_range(pixels[~again])
        return low, high

    def retraced_range(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The range of the regular samples of some pixels, which are traced again."""
        band = self.band
        x, y = regular_samples(pixels, band.side, band.resolution[0], band.first_row)
        place = band.lanes(x.ravel(), y.ravel())
        color, _ = kernels.labelled_samples(*band.inputs, *place, dr.opaque(ad.Bool, False))
        seen = stacked(to_numpy(color), slice(x.size)).reshape(3, *x.shape)
        return seen.min(1), seen.max(1)


def _rounds(
    band: Band, pairs: Pairs, keep: bool
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, Crossing]]:
    """Edges between pairs of samples, and then those in the rest of the segments.

    While the crossings of a round are used, those of the next round are already being computed.

    Yields:
        The pair of each edge, in order; its lane; the pairs with edges that are not found; and the
        crossings, with NumPy arrays in what is needed.
    """

    def search(pair: np.ndarray, *rest: np.ndarray) -> Crossing:
        line = (column.take(pair) for column in (pairs.x, pairs.y, pairs.vertical, pairs.length))
        return kernels.crossings(*band.inputs, Segment(*band.lanes(*line, *rest)))

    pair = interleaved(np.arange(len(pairs)))
    start, stop, ends = np.zeros(len(pair)), pairs.length.take(pair), pairs.label.take(pair, 1)
    rounds = settings.ROUNDS if searches_crowds(band) else settings.ROUNDS_WITHOUT_CROWDS
    following = search(pair, start, stop, *ends) if len(pair) else None
    for left_over in reversed(range(rounds)):
        if following is None:
            return
        crossing, here, n = _fetched(following, keep), pair, len(pair)

        # The rest of the segment, on either side of the crossing
        left, right = (
            np.flatnonzero(crossing.more_before[:n]),
            np.flatnonzero(crossing.more_behind[:n]),
        )
        label_starts = np.concatenate([ends[0, left], crossing.label_behind[right]])
        label_stops = np.concatenate([crossing.label_before[left], ends[1, right]])
        ends = np.stack([label_starts, label_stops])
        start = np.concatenate([start[left], (crossing.along + crossing.gap)[right]])
        stop = np.concatenate([(crossing.along - crossing.gap)[left], stop[right]])
        pair = np.concatenate([here[left], here[right]])
        following = search(pair, start, stop, *ends) if left_over and len(pair) else None

        lost = here[~crossing.found[:n]]
        if not left_over:
            lost = np.concatenate([lost, pair])
        lane = np.flatnonzero(crossing.found[:n])
        lane = lane.take(np.argsort(here.take(lane), kind="stable"))
        yield here.take(lane), lane, lost, crossing


def _fetched(crossing: Crossing, keep: bool) -> Crossing:
    """Crossings with NumPy arrays, in all that images need, or that derivatives need as well."""
    needed = {k: to_numpy(v) for k, v in vars(crossing).items() if keep or k not in OF_DERIVATIVES}
    return replace(crossing, **needed)
