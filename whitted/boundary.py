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
   the other, with different labels have an edge in between.
2. Walk both trees at once for the heaviest node that decides differently, tell the event there and find the root of its
   level function phi along the segment (`crossing.py`). Where the labels beside the root are not those of the
   samples, more edges are in the segment, and the search goes on in what is left of it.
3. The part of the segment's line that lies behind the crossing goes from one sample to the other: (c - middle) (f- - f+) h.
   Beside silhouettes, where f is a + b sqrt(distance) + ... and its derivative infinite, and likewise at the onset of
   total reflection, other samples take the place of the two (`quadrature.py`). They are differentiated like any others.
4. Where a parameter moves, the crossing at c moves by -phi_theta / phi_c. The segment's line stands for a strip of width
   h, in which the edge is taken to be straight, and its area changes by h times that, of which each pixel gets the part
   of the edge that lies in it. phi_theta is the derivative along one chain of rays, in forward or in reverse mode.
5. Horizontal segments see an edge well that is steep, vertical ones one that is flat. Both sums are correct for
   edges that they see, and are joined with weights g_x^4 / (g_x^4 + g_y^4) and g_y^4 / (g_x^4 + g_y^4), g the gradient of phi
   in the image, which also keep each term bounded: g_x^3 / (g_x^4 + g_y^4) <= 1.14 / |g|.
6. A pixel with three labels or more around it has edges that meet or crowd. It is sampled anew, two or four times as
   finely, with the same method (adaptive subdivision: Whitted 1980).

Its cost follows the number of edges: two trees and some chains of rays for each, and two to six trees more.

What it leaves to the samples, less of it the more samples a pixel has: edges of nodes that weigh less than FAINT / spp in
the pixel (`render.py`), and where neighbours differ by less than CONTRAST / spp; edges of an object or a gap that lies
between two samples of the same label; checkerboards finer than a third of the finer grid's spacing.

Sources: Reynolds transport and edge sampling, T.-M. Li et al., "Differentiable Monte Carlo Ray Tracing through Edge
Sampling" (2018); discontinuities of programs, S. Bangaru et al., "Systematically Differentiating Parametric
Discontinuities" (2021), Y. Yang et al., "A-delta: Autodiff for Discontinuous Programs" (2022); edges snapped to segments
between samples, the closest to this, Y. Belhe et al. (2025); adaptive subdivision, T. Whitted, "An Improved
Illumination Model for Shaded Display" (1980).
"""

from dataclasses import replace

import numpy as np
from drjit.llvm import ad

from . import probe, wavefront
from .correction import Correction, Finer, Moving, Stretches, add, numbers_of
from .crossing import Segment
from .edges import (
    Crossings,
    Pairs,
    contrasting,
    dense_pairs,
    deposit,
    fine_pairs,
    fine_positions,
    joined,
    label_counts,
    positions,
    take,
)
from .events import NOTHING, SILHOUETTE, TOTAL
from .geometry import Array
from .quadrature import Stretch
from .region import LANES, SAMPLES, Band, chunks, columns, number

# Edges between samples that differ less, relative to the brighter one and for one sample a pixel, are left to the samples
CONTRAST = 1 / 32
# Searches for edges in what is left of a segment; half as many with a single sample a pixel
ROUNDS = 6


def correct(band: Band, keep: bool) -> tuple[Array, Correction]:
    """A band's pixels, row-major with RGB interleaved, and, if it is to be kept, what their derivatives need."""
    return _Search(band, keep).run()


class _Search:
    """The search for a band's edges.

    All samples, regular and finer, are numbered in the order in which they are traced.
    """

    def __init__(self, band: Band, keep: bool) -> None:
        self.band, self.keep = band, keep
        self.contrast = CONTRAST / band.side**2
        film = band.film(1)
        self.flat, colors, labels = wavefront.labelled_image(band.shape, band.parameters, film, band.limits)
        self.image = self.flat.numpy().reshape(-1, 3)
        self.grid = labels.numpy().reshape((band.rows + 2) * band.side, -1)
        self.colors = colors.numpy().reshape(-1, 3)
        self.count, self.weights = self.grid.size, np.ones((0, 1))
        self.finer: list[tuple[int, np.ndarray, int]] = []
        self.result = Correction(band, np.empty(0))

    def run(self) -> tuple[Array, Correction]:
        band, image = self.band, self.image
        pairs = dense_pairs(self.grid, self.colors, band.side, band.first_row)
        touched = np.zeros(len(image) + 1, bool)
        touched[pairs.pixel] = True
        busy = np.flatnonzero(touched[:-1])
        counts = label_counts(self.grid, self.colors, band.side, busy, self.contrast)
        # With a single sample a pixel, three labels are often one edge that ends at another
        meets, crowds = (busy[counts == 3], busy[counts > 3]) if band.side == 1 else (busy[:0], busy[counts > 2])
        busy = np.concatenate([meets, crowds])

        # Busy pixels are done apart
        touched[:] = False
        touched[busy] = True
        pixel = np.where(touched[pairs.pixel], -1, pairs.pixel)
        pairs = take(replace(pairs, pixel=pixel), np.flatnonzero((pixel >= 0).any(1)))
        groups = [contrasting(pairs, self.contrast)]
        for pixels, side in ((meets, 2), (crowds, band.side * (4 if band.side <= 4 else 2))):
            for part in chunks(len(pixels), max(1, SAMPLES // (side + 2) ** 2)):
                groups.append(self.refine(pixels[part], side))
        pairs = joined(groups)
        if self.keep:
            self.weights = np.ones((self.count, 1), number(band.real))
        for part in chunks(len(pairs), LANES):
            self.cross(pairs if len(pairs) <= LANES else take(pairs, np.arange(part.start, part.stop)))

        if self.keep:
            self.keep_samples(busy)
        return self.flat, self.result

    def keep_samples(self, busy: np.ndarray) -> None:
        """What is left of the samples, for the derivatives."""
        band = self.band
        side, columns = band.side, band.resolution[0]
        regular = self.weights[: self.grid.size].reshape(self.grid.shape)[side:-side, side:-side]
        regular = np.ascontiguousarray(regular)
        regular.reshape(band.rows, side, columns, side).transpose(0, 2, 1, 3)[busy // columns, busy % columns] = 0
        self.result.weights = regular.ravel()
        for first, pixels, side in self.finer:
            shape = len(pixels), side + 2, side + 2
            weights = self.weights[first : first + len(pixels) * (side + 2) ** 2].reshape(shape)
            self.result.finer.append(Finer(pixels, side, weights[:, 1:-1, 1:-1] / side**2))

    def refine(self, pixels: np.ndarray, side: int) -> Pairs:
        """Sample pixels anew, more finely."""
        band = self.band
        x, y = fine_positions(pixels, band.resolution[0], side, band.first_row)
        color, label = probe.samples(*band.inputs, *band.lanes(x.ravel(), y.ravel()))
        colors = columns(color, x.size)
        self.image[pixels] = colors.reshape(*x.shape, 3)[:, 1:-1, 1:-1].mean((1, 2))
        first, self.count = self.count, self.count + x.size
        self.finer.append((first, pixels, side))
        labels = label.numpy()[: x.size].reshape(x.shape)
        return fine_pairs(labels, colors, x, y, pixels, first)

    def cross(self, pairs: Pairs) -> None:
        """Find the edges between pairs of samples, and correct the pixels."""
        band = self.band
        if not len(pairs):
            return
        found, edge = _find(band, pairs)
        if not len(found):
            return
        stretched = found.stretched()
        pixel = found.pairs.pixel
        deposit(self.image, pixel, found.moved(stretched))
        if stretched.any():
            stretched = np.flatnonzero(stretched)
            part = take(found, stretched)
            numbers, taken = part.stretches()
            add(self.image, part.pairs.pixel, probe.stretches(*band.inputs, Stretch(*band.lanes(*numbers.values()))))
            away = taken * part.pairs.length[:, None] ** 2
            deposit(self.image, part.pairs.pixel, -part.pairs.color * away[:, :, None])
            if self.keep:
                self.result.stretches.append(Stretches(numbers, part.pairs.pixel))
                deposit(self.weights, part.pairs.sample, -taken[:, :, None])
        if self.keep:
            self.result.edges.append(Moving(*positions(found.pairs, found.along), pixel, found.change(), edge))


def _find(band: Band, pairs: Pairs) -> tuple[Crossings, dict[str, np.ndarray]]:
    """Edges between pairs of samples, in the order of `Crossings`, and their paths and events."""
    single = band.real is ad.Float
    ulp = float(np.finfo(number(band.real)).eps) * max(band.resolution)
    gaps = np.maximum(pairs.length * (2.0**-10 if single else 1e-6), 8 * ulp)
    pair, start, length, labels = np.arange(len(pairs)), np.zeros(len(pairs)), pairs.length, pairs.label
    groups: list[dict[str, np.ndarray]] = []
    for _ in range(ROUNDS if band.side > 1 else ROUNDS // 2):
        n, here, gap = len(pair), pairs if not groups else take(pairs, pair), gaps[pair]
        segment = Segment(*band.lanes(*positions(here, start), here.vertical, length))
        crossing, jump, label_before, label_behind = probe.crossings(*band.inputs, segment, *band.lanes(gap))
        t, slope, across = (value.numpy()[:n] for value in (crossing.t, crossing.slope, crossing.across))
        valid = crossing.edge.event.kind.numpy()[:n] != NOTHING
        valid &= np.isfinite(t) & np.isfinite(slope) & np.isfinite(across) & (slope != 0)
        along = start + np.where(valid, t, 0) * length
        left_label, right_label = label_before.numpy()[:n], label_behind.numpy()[:n]
        kept = np.flatnonzero(valid & (left_label != right_label))
        numbers = {"pair": pair, "along": along, "slope": slope, "across": across}
        group = {name: value[kept] for name, value in numbers.items()}
        group["jump"] = columns(jump, n)[kept]
        groups.append(group | numbers_of(crossing.edge, kept))

        # What is left of the segment on either side
        stop = start + length
        left = np.flatnonzero(valid & (left_label != labels[:, 0]) & (along - start > 2 * gap))
        right = np.flatnonzero(valid & (right_label != labels[:, 1]) & (stop - along > 2 * gap))
        ends = np.stack([labels[left, 0], left_label[left]], 1), np.stack([right_label[right], labels[right, 1]], 1)
        length = np.concatenate([(along - gap - start)[left], (stop - along - gap)[right]])
        start = np.concatenate([start[left], (along + gap)[right]])
        pair, labels = np.concatenate([pair[left], pair[right]]), np.concatenate(ends)
        if not len(pair):
            break
    table = {name: np.concatenate([group[name] for group in groups]) for name in groups[0]}
    # By pair, then by distance, which is less than a pixel
    order = np.argsort(table["pair"] + table["along"] / 2, kind="stable")
    table = {name: value.take(order, 0) for name, value in table.items()}
    pair, along, slope, across, jump = (table.pop(name) for name in ("pair", "along", "slope", "across", "jump"))
    singular = (table["kind"] == SILHOUETTE) | (table["kind"] == TOTAL)
    return Crossings(take(pairs, pair), pair, along, slope, across, jump, singular), table
