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
2. Walk both trees at once to the first node that decides differently, tell the event there and find the root of its
   level function phi along the segment (`crossing.py`). Where the labels beside the root are not those of the
   samples, more edges are in the segment, and the search goes on in what is left of it.
3. Between the two samples f is integrated anew, with Gauss's points in the square root of the distance to the edge on
   either side, because near a silhouette f is a + b sqrt(distance) + ... and its derivative infinite (`edges.py`).
   These samples are differentiated like any others, so that the interior term is as accurate as the pixels.
4. Where a parameter moves, the crossing at c moves by -phi_theta / phi_c. The segment's line stands for a strip of width
   h, in which the edge is taken to be straight, and its area changes by h times that, of which each pixel gets the part
   of the edge that lies in it. phi_theta is the derivative along one chain of rays, in forward or in reverse mode.
5. Horizontal segments see an edge well that is steep, vertical ones one that is flat. Both sums are correct for
   edges that they see, and are joined with weights g_x^4 / (g_x^4 + g_y^4) and g_y^4 / (g_x^4 + g_y^4), g the gradient of phi
   in the image, which also keep each term bounded: g_x^3 / (g_x^4 + g_y^4) <= 1.14 / |g|.
6. A pixel with three labels or more around it has edges that meet or crowd. It is sampled anew, REFINEMENT times as
   finely, with the same method (adaptive subdivision: Whitted 1980).

What it leaves to the samples: edges of nodes that weigh less than `trace.FAINT`; edges between two samples of the same
label, of an object or a gap that no sample sees (more samples see it); a fourth edge and more between two neighbours of
the finer grid.

Sources: Reynolds transport and edge sampling, T.-M. Li et al., "Differentiable Monte Carlo Ray Tracing through Edge
Sampling" (2018); discontinuities of programs, S. Bangaru et al., "Systematically Differentiating Parametric
Discontinuities" (2021), Y. Yang et al., "A-delta: Autodiff for Discontinuous Programs" (2022); edges snapped to segments
between samples, the closest to this, Y. Belhe et al. (2025); adaptive subdivision, T. Whitted, "An Improved
Illumination Model for Shaded Display" (1980).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace

import drjit as dr
import numpy as np
from drjit.llvm import ad

from . import probe, wavefront
from .chain import Path
from .crossing import Segment
from .derivative import Edge
from .edges import Crossings, Pairs, contrasting, dense_pairs, deposit, fine_pairs, fine_positions
from .edges import joined, label_counts, positions, take
from .events import NOTHING, SILHOUETTE, TOTAL, Event
from .film import Film, band
from .geometry import Array
from .quadrature import Stretch
from .scene import Shape
from .trace import Limits

TERMS = ("both", "interior", "boundary")
CONTRAST = 1 / 32
# Searches for edges in what is left of a segment
ROUNDS = 6
# Most lanes of one call of a kernel: those of derivatives keep all parameters' derivatives for each lane
SAMPLES = 1 << 20
LANES = 1 << 17
PACKET = 16


@dataclass(frozen=True)
class Band:
    """Some rows of an image."""

    shape: Shape
    parameters: dict[str, Array]
    limits: Limits
    resolution: tuple[int, int]  # of the whole image
    first_row: int
    rows: int
    side: int  # samples along a pixel's side

    @property
    def real(self) -> type:
        return type(self.shape.scene.camera.fov)

    @property
    def contrast(self) -> float:
        """Edges between samples that differ less, relative to the brighter one, are left to the samples."""
        return CONTRAST / self.side**2

    def film(self, margin: int) -> Film:
        return band(self.resolution, self.first_row, self.rows, self.side, self.real, margin)

    @property
    def inputs(self) -> tuple:
        """What all kernels of `probe` take first."""
        return self.shape, self.parameters, self.film(0).size, self.limits

    def lanes(self, *arrays: np.ndarray) -> list[Array]:
        """Dr.Jit arrays of whole packets."""
        return [lanes(array if array.dtype == bool else array.astype(number(self.real), copy=False)) for array in arrays]

    def color(self, array: np.ndarray) -> Array:
        return type(self.shape.scene.background)(*self.lanes(*array.T))


def number(real: type) -> type:
    """NumPy's type for a Dr.Jit type of numbers."""
    return np.float32 if real is ad.Float else np.float64


KINDS = {np.dtype(kind): name for kind, name in zip((bool, "f4", "f8", "u4", "u8"), ("Bool", "Float", "Float64", "UInt", "UInt64"), strict=True)}


def lanes(array: np.ndarray) -> Array:
    """A Dr.Jit array of whole packets, as kernels want more than one lane; zeros fill the last one up."""
    return aligned(array, -(-len(array) // PACKET) * PACKET)


def aligned(array: np.ndarray, length: int) -> Array:
    """A Dr.Jit array in Dr.Jit's memory, as one in NumPy's, of another alignment, would get a kernel of its own."""
    result = dr.empty(getattr(ad, KINDS[array.dtype]), length)
    memory = result.numpy()
    memory[: len(array)], memory[len(array) :] = array, 0
    return result


def columns(value: Array, n: int) -> np.ndarray:
    """The first n elements of a vector array's components, shape (n, components)."""
    return np.stack([component.numpy()[:n] for component in value], 1)


def chunks(n: int, size: int) -> Iterator[slice]:
    for first in range(0, n, size):
        yield slice(first, min(first + size, n))


@dataclass(frozen=True)
class Samples:
    """Finer samples, each of one pixel."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class Stretches:
    """Samples beside singular edges, by the fields of `quadrature.Stretch`."""

    numbers: dict[str, np.ndarray]
    pixel: np.ndarray  # (N, 2)


@dataclass(frozen=True)
class Moving:
    """Points on edges, each with what it changes in two pixels when the level function there grows."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray  # (N, 2)
    change: np.ndarray  # (N, 2, 3)
    edge: dict[str, np.ndarray]


@dataclass
class Correction:
    """What makes a band's pixels those of its regular samples and edges, and not of the samples alone."""

    band: Band
    weights: np.ndarray  # what the band's regular samples still count for, row by row of samples
    samples: list[Samples] = field(default_factory=list)
    stretches: list[Stretches] = field(default_factory=list)
    edges: list[Moving] = field(default_factory=list)

    def sample_weights(self) -> Array | None:
        """The regular samples' weights, if there are several in a pixel."""
        return aligned(self.weights, len(self.weights)) if self.band.side > 1 else None

    def weigh_pixels(self, image: np.ndarray) -> None:
        """Multiply pixels by the weights of their only samples."""
        if self.band.side == 1:
            changed = np.flatnonzero(self.weights != 1)
            image[changed] *= self.weights[changed, None]

    def tangent(self, wrt: dict, tangents: dict, terms: str) -> Array:
        """The pixels' derivative along the tangents of the parameters `wrt`."""
        band = self.band
        image = np.zeros((band.rows * band.resolution[0], 3), number(band.real))
        if terms != "boundary":
            inputs = band.shape, band.parameters, band.film(0), band.limits, wrt, tangents
            image[:] = wavefront.image_jvp(*inputs, self.sample_weights()).numpy().reshape(-1, 3)
            self.weigh_pixels(image)
            for samples in self.samples:
                slope = probe.samples_jvp(*band.inputs, wrt, tangents, *band.lanes(samples.x, samples.y))
                deposit(image, samples.pixel, columns(slope, len(samples.x)) * samples.weight[:, None])
            for stretches in self.stretches:
                stretch = Stretch(*band.lanes(*stretches.numbers.values()))
                _add(image, stretches.pixel, probe.stretches_jvp(*band.inputs, wrt, tangents, stretch))
        if terms != "interior":
            for edges in self.edges:
                x, y = band.lanes(edges.x, edges.y)
                slope = probe.levels_jvp(*band.inputs, wrt, tangents, x, y, _edge(edges.edge)).numpy()[: len(edges.x)]
                deposit(image, edges.pixel, edges.change * slope[:, None, None])
        return aligned(image.ravel(), image.size)

    def adjoint(self, wrt: dict, image: Array, terms: str) -> dict:
        """The derivatives of dot(image, pixels) by the parameters `wrt`."""
        band, parts = self.band, []
        seeds = image.numpy().reshape(-1, 3)
        if terms != "boundary":
            plain = aligned(seeds.ravel(), seeds.size)
            self.weigh_pixels(plain.numpy().reshape(-1, 3))
            inputs = band.shape, band.parameters, band.film(0), band.limits, wrt, plain
            parts.append(wavefront.image_vjp(*inputs, self.sample_weights()))
            for samples in self.samples:
                seed = band.color(seeds[samples.pixel] * samples.weight[:, None])
                parts.append(probe.samples_vjp(*band.inputs, wrt, seed, *band.lanes(samples.x, samples.y)))
            for stretches in self.stretches:
                stretch = Stretch(*band.lanes(*stretches.numbers.values()))
                both = (band.color(seeds[stretches.pixel[:, k]]) for k in (0, 1))
                parts.append(probe.stretches_vjp(*band.inputs, wrt, stretch, *both))
        if terms != "interior":
            for edges in self.edges:
                seed = (seeds[edges.pixel] * edges.change).sum((1, 2))
                parts.append(probe.levels_vjp(*band.inputs, wrt, *band.lanes(seed, edges.x, edges.y), _edge(edges.edge)))
        return {name: sum((part[name] for part in parts), start=dr.zeros(type(value))) for name, value in wrt.items()}


def _add(image: np.ndarray, pixel: np.ndarray, both: tuple[Array, Array]) -> None:
    """Add to the pixels of a and of b."""
    deposit(image, pixel, np.stack([columns(value, len(pixel)) for value in both], 1))


def _edge(numbers: dict[str, np.ndarray]) -> Edge:
    """The Dr.Jit arrays of `_numbers`."""
    arrays = {name: lanes(value) for name, value in numbers.items()}
    return Edge(*(kind(*(arrays[f.name] for f in fields(kind))) for kind in (Path, Event)))


def _numbers(edge: Edge, which: np.ndarray) -> dict[str, np.ndarray]:
    """Some of the edges, by the fields of their paths and events."""
    return {name: value.numpy()[which] for part in (edge.path, edge.event) for name, value in vars(part).items()}


def correct(band: Band, keep: bool) -> tuple[Array, Correction]:
    """A band's pixels, row-major with RGB interleaved, and, if it is to be kept, what their derivatives need."""
    return _Search(band, keep).run()


class _Search:
    """The search for a band's edges.

    All samples, regular and finer, are numbered in the order in which they are traced.
    """

    def __init__(self, band: Band, keep: bool) -> None:
        self.band, self.keep = band, keep
        film = band.film(1)
        self.flat, colors, labels = wavefront.labelled_image(band.shape, band.parameters, film, band.limits)
        self.image = self.flat.numpy().reshape(-1, 3)
        self.grid = labels.numpy().reshape((band.rows + 2) * band.side, -1)
        self.colors = colors.numpy().reshape(-1, 3)
        self.count, self.weights = self.grid.size, np.ones((0, 1))
        self.fine: list[tuple] = []
        self.result = Correction(band, np.empty(0))

    def run(self) -> tuple[Array, Correction]:
        band, image = self.band, self.image
        pairs = dense_pairs(self.grid, self.colors, band.side, band.first_row)
        touched = np.zeros(len(image) + 1, bool)
        touched[pairs.pixel] = True
        busy = np.flatnonzero(touched[:-1])
        counts = label_counts(self.grid, self.colors, band.side, busy, band.contrast)
        # With a single sample a pixel, three labels are often one edge that ends at another
        meets, crowds = (busy[counts == 3], busy[counts > 3]) if band.side == 1 else (busy[:0], busy[counts > 2])
        busy = np.concatenate([meets, crowds])

        # Busy pixels are done apart
        touched[:] = False
        touched[busy] = True
        pixel = np.where(touched[pairs.pixel], -1, pairs.pixel)
        pairs = take(replace(pairs, pixel=pixel), np.flatnonzero((pixel >= 0).any(1)))
        groups = [contrasting(pairs, band.contrast)]
        if len(meets):
            groups.append(contrasting(self.refine(meets, 2 * band.side), band.contrast))
        for part in chunks(len(crowds), max(1, SAMPLES // (4 * band.side + 2) ** 2)):
            groups.append(self.refine(crowds[part], 4 * band.side))
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
        for first, x, y, own in self.fine:
            weight = self.weights[first : first + x.size].reshape(x.shape)[:, 1:-1, 1:-1] / (x.shape[1] - 2) ** 2
            x, y = x[:, 1:-1, 1:-1].ravel(), y[:, 1:-1, 1:-1].ravel()
            for part in chunks(len(x), LANES):
                self.result.samples.append(Samples(x[part], y[part], own[part], weight.ravel()[part]))

    def refine(self, pixels: np.ndarray, side: int) -> Pairs:
        """Sample pixels anew, more finely."""
        band = self.band
        x, y = fine_positions(pixels, band.resolution[0], side, band.first_row)
        color, label = probe.samples(*band.inputs, *band.lanes(x.ravel(), y.ravel()))
        colors = columns(color, x.size)
        self.image[pixels] = colors.reshape(*x.shape, 3)[:, 1:-1, 1:-1].mean((1, 2))
        first, self.count = self.count, self.count + x.size
        self.fine.append((first, x, y, np.repeat(pixels, side**2)))
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
            _add(self.image, part.pairs.pixel, probe.stretches(*band.inputs, Stretch(*band.lanes(*numbers.values()))))
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
    groups = []
    for _ in range(ROUNDS):
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
        groups.append(group | _numbers(crossing.edge, kept))

        # What is left of the segment on either side
        stop = start + length
        left = np.flatnonzero(valid & (left_label != labels[:, 0]) & (along - start > 2 * gap))
        right = np.flatnonzero(valid & (right_label != labels[:, 1]) & (stop - along > 2 * gap))
        ends = np.stack([labels[left, 0], left_label[left]], 1), np.stack([right_label[right], labels[right, 1]], 1)
        length = np.concatenate([(along - gap - start)[left], (stop - along - gap)[right]])
        start = np.concatenate([start[left], (along + gap)[right]])
        pair, labels = np.concatenate([pair[left], pair[right]]), np.concatenate(ends)
        # With a single sample a pixel, the last few are not worth a call
        if len(pair) <= (len(pairs) // 50 if band.side == 1 else 0):
            break
    table = {name: np.concatenate([group[name] for group in groups]) for name in groups[0]}
    # By pair, then by distance, which is less than a pixel
    order = np.argsort(table["pair"] + table["along"] / 2, kind="stable")
    table = {name: value.take(order, 0) for name, value in table.items()}
    numbers = [table.pop(name) for name in ("pair", "along", "slope", "across", "jump")]
    singular = (table["kind"] == SILHOUETTE) | (table["kind"] == TOTAL)
    return Crossings(take(pairs, numbers[0]), *numbers, singular), table
