"""The search for the edges in a band, which corrects the band's pixels."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..core.arrays import Array
from ..core.host import chunks, stacked, to_numpy
from ..sampling.band import Band
from . import kernels, settings
from .found import Crossed, Found, columns_of
from .grid import Samples, band_samples, fine_samples, neighbours_across_edges
from .locate import Crossing, Segment
from .pairs import Crossings, Moves, Pairs, interleaved, pairs_of
from .refinement import groups_to_refine
from .tables import concatenated, deposit, rows_of


def correct(band: Band, keep: bool) -> tuple[Array, Found | None]:
    """A band's pixels, row-major with RGB interleaved, corrected where edges cross them.

    Args:
        keep: also return what the derivatives of the pixels need.
    """
    return _Search(band, keep).run()


class _Search:
    """The search for a band's edges.

    All samples, regular and finer, are numbered in the order in which they are traced.
    """

    def __init__(self, band: Band, keep: bool) -> None:
        self.band, self.keep = band, keep
        inputs = band.structure, band.parameters, band.film(margin=1), band.limits
        self.flat, labels = kernels.labelled_image(*inputs)
        self.image = self.flat.numpy()
        grid = labels.numpy().reshape((band.rows + 2) * band.side, -1)
        self.samples = band_samples(grid, band.side, band.first_row)
        self.moves: dict[int, list[Moves]] = {}  # by the round of the search
        self.crossed: list[Crossed] = []  # one for each chunk of pairs

    def run(self) -> tuple[Array, Found | None]:
        band, samples = self.band, self.samples
        a, b, ends = neighbours_across_edges(samples)
        groups = groups_to_refine(samples, ends)
        columns, top = band.resolution[0], band.first_row
        finer = [(pixels, side) for pixels, side in groups if pixels.size]
        places = [fine_samples(pixels, side, columns, top) for pixels, side in finer]
        traced = self.trace(places)

        # Pixels that are sampled anew have pairs of their own
        refined = np.sort(np.concatenate([pixels for pixels, _ in groups]))
        apart = np.zeros(len(self.image) // 3 + 1, bool)
        apart[refined] = apart[-1] = True
        ends[apart.take(ends)] = -1
        kept = np.flatnonzero(np.maximum(*ends) >= 0)
        regular = pairs_of(samples, a.take(kept), b.take(kept), ends.take(kept, 1))
        fine = self.refine(places, traced)
        within = [pairs_of(group, *neighbours_across_edges(group)) for group in fine]
        pairs = concatenated([regular, *within])
        for part in chunks(len(pairs), settings.LANES):
            whole = len(pairs) <= settings.LANES
            self.cross(pairs if whole else rows_of(pairs, np.arange(part.start, part.stop)))
        self.move()
        return self.flat, Found(band, refined, fine, self.crossed) if self.keep else None

    def trace(self, fine: list[tuple[Samples, np.ndarray]]) -> list[tuple[Array, Array]]:
        """Begin to trace finer samples: their radiance and labels."""
        if not fine:
            return []
        x = np.concatenate([group.x[places] for group, places in fine])
        y = np.concatenate([group.y[places] for group, places in fine])
        parts = chunks(len(x), settings.SAMPLES)
        lanes = (self.band.lanes(x[part], y[part]) for part in parts)
        return [kernels.labelled_samples(*self.band.inputs, *place) for place in lanes]

    def refine(
        self, fine: list[tuple[Samples, np.ndarray]], traced: list[tuple[Array, Array]]
    ) -> list[Samples]:
        """The finer samples with labels; pixels get the mean of their radiance."""
        if not traced:
            return []
        colors = np.concatenate([to_numpy(color) for color, _ in traced], 1).T
        labels = np.concatenate([label.numpy() for _, label in traced])
        result, number, done = [], self.samples.labels.size, 0
        for group, places in fine:
            shape, size = group.labels.shape, group.labels.size
            part = slice(done, done + len(places))
            label, color = np.zeros(size, labels.dtype), np.zeros((size, 3), colors.dtype)
            label[places], color[places] = labels[part], colors[part]
            label = label.take(group.counted(np.arange(size)))
            result.append(replace(group, labels=label.reshape(shape), first=number))
            inside = np.arange(size).reshape(shape)[:, 1:-1, 1:-1].reshape(shape[0], -1).T
            self.image.reshape(-1, 3)[group.pixel.take(inside[0])] = color.take(inside, 0).mean(0)
            number, done = number + size, done + len(places)
        return result

    def cross(self, pairs: Pairs) -> None:
        """Find the edges between pairs of samples, and what they move from pixel to pixel."""
        groups, edges = [], []
        for round, (pair, lane, crossing) in enumerate(_rounds(self.band, pairs)):
            jump = stacked(crossing.jump, lane)
            move = Moves(pairs.pixel.take(pair, 1), stacked(crossing.moved, lane), jump)
            self.moves.setdefault(round, []).append(move)
            if self.keep:
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
        for moves in map(concatenated, self.moves.values()):
            deposit(self.image, moves.pixel, *(moves.moved * channel for channel in moves.jump))


def _rounds(band: Band, pairs: Pairs) -> Iterator[tuple[np.ndarray, np.ndarray, Crossing]]:
    """Edges between pairs of samples, and then those in the rest of the segments.

    While the crossings of a round are used, those of the next round are already being computed.

    Yields:
        The pair of each edge, in order; its lane; and the crossings, with NumPy arrays.
    """

    def search(pair: np.ndarray, *rest: np.ndarray) -> Crossing:
        line = (column.take(pair) for column in (pairs.x, pairs.y, pairs.vertical, pairs.length))
        return kernels.crossings(*band.inputs, Segment(*band.lanes(*line, *rest)))

    pair = interleaved(np.arange(len(pairs)))
    start, stop, ends = np.zeros(len(pair)), pairs.length.take(pair), pairs.label.take(pair, 1)
    rounds = settings.ROUNDS if band.side > 1 else settings.ROUNDS_OF_SINGLE_SAMPLES
    following = search(pair, start, stop, *ends) if len(pair) else None
    for left_over in reversed(range(rounds)):
        if following is None:
            return
        crossing, here, n = to_numpy(following), pair, len(pair)

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

        lane = np.flatnonzero(crossing.found[:n])
        lane = lane.take(np.argsort(here.take(lane), kind="stable"))
        yield here.take(lane), lane, crossing
