"""What edges contribute to pixels and gradients.

A pixel is the integral of a piecewise smooth function f of the image position over a square, and every discontinuity
of f is a curve on which one discrete decision of the tree of rays flips. Samples miss two things of it. Of the pixel,
the part of a sample's cell that lies behind the curve; and of the derivative by a parameter, what the curve moves
(Reynolds' transport theorem):

    d/dtheta of the integral of f  =  integral of df/dtheta  +  integral over the curves of (f- - f+) v_n

where f- and f+ are the values on either side and v_n is the speed of the curve along its normal. The first term, the
interior, is what automatic differentiation of samples gives; the second, the boundary, is what it misses.

The method, on the regular grid of samples with spacing h:

1. Label each sample with a hash of its tree's decisions (`decisions.py`). Two neighbours, side by side or one below
   the other, whose labels differ have an edge in between.
2. Walk both trees at once for the heaviest node that decides differently, tell the event there and find the root of its
   level function phi along the segment (`crossing.py`). Where the labels beside the root are not those of the
   samples, more edges are in the segment, and the search goes on in what is left of it.
3. The part of the segment's line that lies behind the crossing goes from one sample to the other: (c - middle) (f- - f+) h.
   Beside silhouettes, where f is a + b sqrt(distance) + ... and its derivative infinite, likewise at the onset of total
   reflection, and at a crease from which a surface runs off into the distance between two samples, other samples are
   differentiated in place of the two (`quadrature.py`).
4. Where a parameter moves, the crossing at c moves by -phi_theta / phi_c. The segment's line stands for a strip of width
   h, in which the edge is taken to be straight, and its area changes by h times that, of which each pixel gets the part
   of the edge that lies in it. phi_theta is the derivative along one chain of rays, in forward or in reverse mode.
5. Horizontal segments see an edge well that is steep, vertical ones one that is flat. Both sums are correct for
   edges that they see, and are joined with weights g_x^4 / (g_x^4 + g_y^4) and g_y^4 / (g_x^4 + g_y^4), g the gradient of phi
   in the image, which also keep each term bounded: g_x^3 / (g_x^4 + g_y^4) <= 1.14 / |g|.
6. A pixel with three labels or more around it has edges that meet or crowd. It is sampled anew, two or four times as
   finely, with the same method (adaptive subdivision: Whitted 1980).

Its cost follows the number of edges: for each some chains of rays, and of four trees what weighs enough to have an edge.

What it leaves to the samples, less of it the more samples a pixel has: edges of nodes that weigh less than FAINT / spp in
the pixel (`render.py`); edges of an object or a gap that lies between two samples of the same label; checkerboards where
several cells lie between two samples. What moves with those fades out as cells get smaller (`crossing.py`): were it to end at
once, the last edge would lack the one that cancels it. Derivatives by a weight below FAINT / spp, for which edges in what it
reflects or refracts are such, have four times the samples instead.

Sources: Reynolds transport and edge sampling, T.-M. Li et al., "Differentiable Monte Carlo Ray Tracing through Edge
Sampling" (2018); discontinuities of programs, S. Bangaru et al., "Systematically Differentiating Parametric
Discontinuities" (2021), Y. Yang et al., "A-delta: Autodiff for Discontinuous Programs" (2022); edges snapped to segments
between samples, the closest to this, Y. Belhe et al. (2025); adaptive subdivision, T. Whitted, "An Improved
Illumination Model for Shaded Display" (1980).
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from . import probe, wavefront
from .correction import Found, numbers_of
from .crossing import Crossing, Segment
from .edges import (
    Crossings,
    Moves,
    Pairs,
    Samples,
    band_samples,
    crowded,
    deposit,
    fine_samples,
    flips,
    joined,
    label_counts,
    pairs_of,
    take,
)
from .geometry import Array
from .region import LANES, SAMPLES, Band, chunks, dealt, fetched, rows

# Searches for edges in what is left of a segment, with several samples a pixel and with a single one. Beside the outline of
# glass, where it mirrors all that is around it, segments of dozens of edges are common
ROUNDS, FEWER_ROUNDS = 24, 2
# With one sample a pixel, those where edges meet are sampled more finely only if they are more than one in so many
FEW = 8


def correct(band: Band, keep: bool) -> tuple[Array, Found | None]:
    """A band's pixels, row-major with RGB interleaved, and, if it is to be kept, what their derivatives need."""
    return _Search(band, keep).run()


class _Search:
    """The search for a band's edges.

    All samples, regular and finer, are numbered in the order in which they are traced.
    """

    def __init__(self, band: Band, keep: bool) -> None:
        self.band, self.keep = band, keep
        self.flat, labels = wavefront.labelled_image(band.shape, band.parameters, band.film(1), band.limits)
        self.image = self.flat.numpy()
        grid = labels.numpy().reshape((band.rows + 2) * band.side, -1)
        self.samples = band_samples(grid, band.side, band.first_row)
        self.moves: dict[int, list[Moves]] = {}  # by the round of the search
        self.crossed: list[tuple[Pairs, Crossings, dict[str, np.ndarray]]] = []  # what derivatives need of each chunk

    def run(self) -> tuple[Array, Found | None]:
        band, samples = self.band, self.samples
        a, b, ends = flips(samples)
        busy = crowded(ends, band.side)
        counts = label_counts(samples, busy)
        if band.side == 1:
            # Three labels are often one edge that ends at another. A few pixels of five are not worth samples of their own
            five = (counts == 5) & (FEW * np.count_nonzero(counts == 5) >= np.count_nonzero(counts > 2))
            finer = [(busy[(counts > 2) & ~five], 2), (busy[five], 4)]
        else:
            finer = [(busy[counts > 2], band.side * (4 if band.side <= 4 else 2))]
        columns, top = band.resolution[0], band.first_row
        places = [fine_samples(pixels, side, columns, top) for pixels, side in finer if pixels.size]
        traced = self.trace(places)

        # Busy pixels are done apart
        apart = np.zeros(len(self.image) // 3 + 1, bool)
        busy = np.sort(np.concatenate([pixels for pixels, _ in finer]))
        apart[busy] = apart[-1] = True
        ends[apart.take(ends)] = -1
        kept = np.flatnonzero(np.maximum(*ends) >= 0)
        regular = pairs_of(samples, a.take(kept), b.take(kept), ends.take(kept, 1))
        fine = self.refine(places, traced)
        pairs = joined([regular, *(pairs_of(group, *flips(group)) for group in fine)])
        for part in chunks(len(pairs), LANES):
            self.cross(pairs if len(pairs) <= LANES else take(pairs, np.arange(part.start, part.stop)))
        self.move()

        return self.flat, Found(band, busy, fine, self.crossed) if self.keep else None

    def trace(self, fine: list[tuple[Samples, np.ndarray]]) -> list[tuple[Array, Array]]:
        """Begin to trace finer samples: their radiance and labels."""
        if not fine:
            return []
        x, y = (np.concatenate([getattr(group, name)[places] for group, places in fine]) for name in "xy")
        parts = chunks(len(x), SAMPLES)
        return [probe.samples(*self.band.inputs, *self.band.lanes(x[part], y[part])) for part in parts]

    def refine(self, fine: list[tuple[Samples, np.ndarray]], traced: list[tuple[Array, Array]]) -> list[Samples]:
        """The finer samples with labels; pixels get the mean of their radiance."""
        if not traced:
            return []
        colors = np.concatenate([fetched(color) for color, _ in traced], 1).T
        labels = np.concatenate([label.numpy() for _, label in traced])
        result, number, done = [], self.samples.labels.size, 0
        for group, places in fine:
            shape, part = group.labels.shape, slice(done, done + len(places))
            label, color = np.zeros(group.labels.size, labels.dtype), np.zeros((group.labels.size, 3), colors.dtype)
            label[places], color[places] = labels[part], colors[part]
            label = label.take(group.counted(np.arange(label.size)))
            result.append(replace(group, labels=label.reshape(shape), first=number))
            inside = np.arange(label.size).reshape(shape)[:, 1:-1, 1:-1].reshape(shape[0], -1).T
            self.image.reshape(-1, 3)[group.pixel.take(inside[0])] = color.take(inside, 0).mean(0)
            number, done = number + group.labels.size, done + len(places)
        return result

    def cross(self, pairs: Pairs) -> None:
        """Find the edges between pairs of samples, and what they move from pixel to pixel."""
        groups, edges = [], []
        for round, (pair, lane, crossing) in enumerate(_rounds(self.band, pairs)):
            jump = rows(crossing.jump, lane)
            move = Moves(pairs.pixel.take(pair, 1), rows(crossing.moved, lane), jump)
            self.moves.setdefault(round, []).append(move)
            if self.keep:
                change = rows(crossing.change, lane)
                moves = np.flatnonzero(change.any(0))
                lane = lane.take(moves)
                along, *kept = (getattr(crossing, name).take(lane) for name in ("along", "weight", "singular", "behind"))
                groups.append(Crossings(pair.take(moves), along, jump.take(moves, 1), change.take(moves, 1), *kept))
                edges.append(numbers_of(crossing.edge, lane))
        if any(groups):
            edge = {name: np.concatenate([edge[name] for edge in edges]) for name in edges[0]}
            self.crossed.append((pairs, joined(groups), edge))

    def move(self) -> None:
        """Correct the pixels, in an order that does not depend on the chunks: sums are the same to the last bit."""
        for moves in map(joined, self.moves.values()):
            deposit(self.image, moves.pixel, *(moves.moved * channel for channel in moves.jump))


def _rounds(band: Band, pairs: Pairs) -> Iterator[tuple[np.ndarray, np.ndarray, Crossing]]:
    """Edges between pairs of samples, and then those in what is left of the segments: each one's pair, in order, and lane.

    The crossings' arrays are NumPy's. While they are used, those of the next round are already being computed.
    """

    def search(pair: np.ndarray, *rest: np.ndarray) -> Crossing:
        line = pairs.x, pairs.y, pairs.vertical, pairs.length
        return probe.crossings(*band.inputs, Segment(*band.lanes(*(value.take(pair) for value in line), *rest)))

    pair = dealt(np.arange(len(pairs)))
    start, stop, ends = np.zeros(len(pair)), pairs.length.take(pair), pairs.label.take(pair, 1)
    rounds = ROUNDS if band.side > 1 else FEWER_ROUNDS
    following = search(pair, start, stop, *ends) if len(pair) else None
    for left_over in reversed(range(rounds)):
        if following is None:
            return
        crossing, here, n = fetched(following), pair, len(pair)

        # What is left of the segment on either side
        left, right = np.flatnonzero(crossing.more_before[:n]), np.flatnonzero(crossing.more_behind[:n])
        along, gap, before, behind = crossing.along, crossing.gap, crossing.label_before, crossing.label_behind
        ends = np.stack([np.concatenate([ends[0, left], behind[right]]), np.concatenate([before[left], ends[1, right]])])
        start, stop = np.concatenate([start[left], (along + gap)[right]]), np.concatenate([(along - gap)[left], stop[right]])
        pair = np.concatenate([here[left], here[right]])
        following = search(pair, start, stop, *ends) if left_over and len(pair) else None

        lane = np.flatnonzero(crossing.found[:n])
        lane = lane.take(np.argsort(here.take(lane), kind="stable"))
        yield here.take(lane), lane, crossing
