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
from .edges import Crossings, Pairs, busy_pixels, contrasting, dense_pairs, deposit, fine_pairs, fine_positions
from .edges import joined, positions, take
from .events import NOTHING, SILHOUETTE, TOTAL, Event
from .film import Film, band
from .geometry import Array
from .quadrature import Stretch
from .scene import Shape
from .trace import Limits

TERMS = ("both", "interior", "boundary")
CONTRAST = 1 / 32
# Searches for edges in what is left of a segment
ROUNDS = 3
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
    def fine_side(self) -> int:
        """Samples along the side of a pixel in which edges meet."""
        return self.side * (2 if self.side == 1 else 4)

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
    """A Dr.Jit array in memory of its own, as one in NumPy's memory of other alignment would get a kernel of its own."""
    memory = np.zeros(length * array.itemsize + 64, np.uint8)
    start = -memory.ctypes.data % 64
    own = memory[start : start + length * array.itemsize].view(array.dtype)
    own[: len(array)] = array
    return getattr(ad, KINDS[array.dtype])(own)


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

    def tangent(self, wrt: dict, tangents: dict, terms: str) -> Array:
        """The pixels' derivative along the tangents of the parameters `wrt`."""
        band = self.band
        image = np.zeros((band.rows * band.resolution[0], 3), number(band.real))
        if terms != "boundary":
            film, weights = band.film(0), aligned(self.weights, len(self.weights))
            flat = wavefront.image_jvp(band.shape, band.parameters, film, band.limits, wrt, tangents, weights)
            image[:] = flat.numpy().reshape(-1, 3)
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
            film, weights = band.film(0), aligned(self.weights, len(self.weights))
            parts.append(wavefront.image_vjp(band.shape, band.parameters, film, band.limits, wrt, image, weights))
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
    numbers = {name: value.numpy() for part in (edge.path, edge.event) for name, value in vars(part).items()}
    # What is the same in all lanes has width 1
    return {name: value[which if len(value) > 1 else np.zeros_like(which)] for name, value in numbers.items()}


def correct(band: Band) -> tuple[Array, Correction]:
    """A band's pixels, row-major with RGB interleaved, and what their derivatives need."""
    return _Search(band).run()


class _Search:
    """The search for a band's edges.

    All samples, regular and finer, are numbered in the order in which they are traced.
    """

    def __init__(self, band: Band) -> None:
        self.band = band
        film = band.film(1)
        self.flat, colors, labels = wavefront.labelled_image(band.shape, band.parameters, film, band.limits)
        self.image = self.flat.numpy().reshape(-1, 3)
        self.grid = labels.numpy().reshape((band.rows + 2) * band.side, -1)
        # Of all samples
        self.colors, self.labels = colors.numpy().reshape(-1, 3), self.grid.ravel()
        self.weights = np.ones((0, 1))
        self.fine: list[tuple] = []
        self.result = Correction(band, np.empty(0))

    def run(self) -> tuple[Array, Correction]:
        band, image = self.band, self.image
        pairs = contrasting(dense_pairs(self.grid, band.side, band.first_row), self.colors, band.contrast)
        touched = np.zeros(len(image) + 1, bool)
        touched[pairs.pixel] = True
        busy = busy_pixels(self.grid, band.side, np.flatnonzero(touched[:-1]))

        # Busy pixels are done apart
        touched[:] = False
        touched[busy] = True
        pixel = np.where(touched[pairs.pixel], -1, pairs.pixel)
        groups = [take(replace(pairs, pixel=pixel), (pixel >= 0).any(1))]
        for part in chunks(len(busy), max(1, SAMPLES // (band.fine_side + 2) ** 2)):
            groups.append(self.refine(busy[part]))
        pairs = joined(groups)
        self.weights = np.ones((len(self.labels), 1), number(band.real))
        for part in chunks(len(pairs), LANES):
            self.cross(pairs if len(pairs) <= LANES else take(pairs, np.arange(part.start, part.stop)))

        # What is left of the samples
        side, columns = band.side, band.resolution[0]
        regular = self.weights[: self.grid.size].reshape(self.grid.shape)[side:-side, side:-side]
        regular = np.ascontiguousarray(regular)
        regular.reshape(band.rows, side, columns, side).transpose(0, 2, 1, 3)[busy // columns, busy % columns] = 0
        self.result.weights = regular.ravel()
        for first, x, y, own in self.fine:
            weight = self.weights[first : first + x.size].reshape(x.shape)[:, 1:-1, 1:-1] / band.fine_side**2
            x, y = x[:, 1:-1, 1:-1].ravel(), y[:, 1:-1, 1:-1].ravel()
            for part in chunks(len(x), LANES):
                self.result.samples.append(Samples(x[part], y[part], own[part], weight.ravel()[part]))
        return self.flat, self.result

    def refine(self, pixels: np.ndarray) -> Pairs:
        """Sample pixels anew, more finely."""
        band, side = self.band, self.band.fine_side
        x, y = fine_positions(pixels, band.resolution[0], side, band.first_row)
        color, label = probe.samples(*band.inputs, *band.lanes(x.ravel(), y.ravel()))
        colors = columns(color, x.size)
        self.image[pixels] = colors.reshape(*x.shape, 3)[:, 1:-1, 1:-1].mean((1, 2))
        labels = label.numpy()[: x.size]
        first = len(self.labels)
        self.fine.append((first, x, y, np.repeat(pixels, side**2)))
        self.colors, self.labels = np.concatenate([self.colors, colors]), np.concatenate([self.labels, labels])
        return contrasting(fine_pairs(labels.reshape(x.shape), x, y, pixels, first), self.colors, band.contrast)

    def cross(self, pairs: Pairs) -> None:
        """Find the edges between pairs of samples, and correct the pixels."""
        band = self.band
        if not len(pairs):
            return
        found, edge = _find(band, pairs, self.labels[pairs.sample])
        if not len(found):
            return
        stretched = found.stretched()
        pixel = found.pairs.pixel
        deposit(self.image, pixel, found.moved(stretched))
        if stretched.any():
            numbers, taken = take(found, stretched).stretches()
            stretches = Stretches(numbers, pixel[stretched])
            self.result.stretches.append(stretches)
            _add(self.image, stretches.pixel, probe.stretches(*band.inputs, Stretch(*band.lanes(*numbers.values()))))
            sample, length = found.pairs.sample[stretched], found.pairs.length[stretched]
            deposit(self.image, stretches.pixel, -self.colors[sample] * (taken * length[:, None] ** 2)[:, :, None])
            deposit(self.weights, sample, -taken[:, :, None])
        self.result.edges.append(Moving(*positions(found.pairs, found.along), pixel, found.change(), edge))


def _find(band: Band, pairs: Pairs, labels: np.ndarray) -> tuple[Crossings, dict[str, np.ndarray]]:
    """Edges between pairs of samples, in the order of `Crossings`, and their paths and events."""
    single = band.real is ad.Float
    ulp = float(np.finfo(number(band.real)).eps) * max(band.resolution)
    pair, start, length, label = np.arange(len(pairs)), np.zeros(len(pairs)), pairs.length, labels
    groups = []
    for _ in range(ROUNDS):
        here, n = take(pairs, pair), len(pair)
        gap = np.maximum(here.length * (2.0**-10 if single else 1e-6), 8 * ulp)
        segment = Segment(*band.lanes(*positions(here, start), here.vertical, length))
        crossing, *beside = probe.crossings(*band.inputs, segment, *band.lanes(gap))
        t, slope, across = (value.numpy()[:n] for value in (crossing.t, crossing.slope, crossing.across))
        valid = crossing.edge.event.kind.numpy()[:n] != NOTHING
        valid &= np.isfinite(t) & np.isfinite(slope) & np.isfinite(across) & (slope != 0)
        along = start + np.where(valid, t, 0) * length
        sides = np.stack([beside[1].numpy()[:n], beside[3].numpy()[:n]], 1)
        kept = np.flatnonzero(valid & (sides[:, 0] != sides[:, 1]))
        jump = columns(beside[0] - beside[2], n)[kept]
        edge = _numbers(crossing.edge, kept)
        singular = (edge["kind"] == SILHOUETTE) | (edge["kind"] == TOTAL)
        groups.append((Crossings(take(here, kept), pair[kept], along[kept], slope[kept], across[kept], jump, singular), edge))

        # What is left of the segment on either side
        before, behind = along - gap - start, start + length - along - gap
        left = np.flatnonzero(valid & (sides[:, 0] != label[:, 0]) & (before > gap))
        right = np.flatnonzero(valid & (sides[:, 1] != label[:, 1]) & (behind > gap))
        ends = np.stack([label[left, 0], sides[left, 0]], 1), np.stack([sides[right, 1], label[right, 1]], 1)
        pair, label = np.concatenate([pair[left], pair[right]]), np.concatenate(ends)
        start = np.concatenate([start[left], (along + gap)[right]])
        length = np.concatenate([before[left], behind[right]])
        if not len(pair):
            break
    found = joined([crossings for crossings, _ in groups])
    order = np.lexsort((found.along, found.pair))
    edge = {name: np.concatenate([part[name] for _, part in groups])[order] for name in groups[0][1]}
    return take(found, order), edge
