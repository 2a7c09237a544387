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
from .edges import Crossings, Pairs, busy_pixels, dense_pairs, deposit, fine_pairs, fine_positions, joined, positions, take
from .events import NOTHING, SILHOUETTE, TOTAL, Event
from .film import Film, band
from .geometry import Array
from .quadrature import Stretch
from .scene import Shape
from .trace import Limits

TERMS = ("both", "interior", "boundary")
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
    """Samples that each count for one pixel."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray


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


@dataclass(frozen=True)
class Correction:
    """What makes a band's pixels those of its regular samples and edges, and not of the samples alone."""

    band: Band
    busy: np.ndarray  # pixels that have finer samples in place of the regular ones
    samples: list[Samples] = field(default_factory=list)
    stretches: list[Stretches] = field(default_factory=list)
    edges: list[Moving] = field(default_factory=list)

    def tangent(self, wrt: dict, tangents: dict, terms: str) -> Array:
        """The pixels' derivative along the tangents of the parameters `wrt`."""
        band = self.band
        image = np.zeros((band.rows * band.resolution[0], 3), number(band.real))
        if terms != "boundary":
            flat = wavefront.image_jvp(band.shape, band.parameters, band.film(0), band.limits, wrt, tangents)
            image[:] = flat.numpy().reshape(-1, 3)
            image[self.busy] = 0
            for samples in self.samples:
                slope = probe.samples_jvp(*band.inputs, wrt, tangents, *band.lanes(samples.x, samples.y))
                deposit(image, samples.pixel, columns(slope, len(samples.x)) / band.fine_side**2)
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
        weights = image.numpy().reshape(-1, 3)
        if terms != "boundary":
            plain = aligned(weights.ravel(), weights.size)
            plain.numpy().reshape(-1, 3)[self.busy] = 0
            parts.append(wavefront.image_vjp(band.shape, band.parameters, band.film(0), band.limits, wrt, plain))
            for samples in self.samples:
                seed = band.color(weights[samples.pixel] / band.fine_side**2)
                parts.append(probe.samples_vjp(*band.inputs, wrt, seed, *band.lanes(samples.x, samples.y)))
            for stretches in self.stretches:
                stretch = Stretch(*band.lanes(*stretches.numbers.values()))
                seeds = (band.color(weights[stretches.pixel[:, k]]) for k in (0, 1))
                parts.append(probe.stretches_vjp(*band.inputs, wrt, stretch, *seeds))
        if terms != "interior":
            for edges in self.edges:
                x, y, seed = band.lanes(edges.x, edges.y, np.einsum("nkc,nkc->n", weights[edges.pixel], edges.change))
                parts.append(probe.levels_vjp(*band.inputs, wrt, seed, x, y, _edge(edges.edge)))
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
    flat, labels = wavefront.labelled_image(band.shape, band.parameters, band.film(1), band.limits)
    width, side = band.resolution[0], band.side
    labels = labels.numpy().reshape((band.rows + 2) * side, (width + 2) * side)
    pixels = flat.numpy().reshape(-1, 3)
    pairs = dense_pairs(labels, side, band.first_row)
    touched = np.zeros(len(pixels) + 1, bool)
    touched[pairs.pixel] = True
    result = Correction(band, busy_pixels(labels, side, np.flatnonzero(touched[:-1])))

    # Busy pixels are done apart
    touched[:] = False
    touched[result.busy] = True
    pairs = replace(pairs, pixel=np.where(touched[pairs.pixel], -1, pairs.pixel))
    groups = [take(pairs, (pairs.pixel >= 0).any(1))]
    for part in chunks(len(result.busy), max(1, SAMPLES // (band.fine_side + 2) ** 2)):
        groups.append(_refine(result, pixels, result.busy[part]))
    pairs = joined(groups)
    for part in chunks(len(pairs), LANES):
        _cross(result, pixels, take(pairs, np.arange(part.start, part.stop)))
    return flat, result


def _refine(result: Correction, image: np.ndarray, pixels: np.ndarray) -> Pairs:
    """Sample pixels anew, more finely."""
    band, side = result.band, result.band.fine_side
    x, y = fine_positions(pixels, band.resolution[0], side, band.first_row)
    color, label = probe.samples(*band.inputs, *band.lanes(x.ravel(), y.ravel()))
    inner = (slice(None), slice(1, -1), slice(1, -1))
    for k, component in enumerate(color):
        image[pixels, k] = component.numpy()[: x.size].reshape(x.shape)[inner].mean((1, 2))
    own = np.repeat(pixels, side**2)
    for part in chunks(len(own), LANES):
        result.samples.append(Samples(x[inner].ravel()[part], y[inner].ravel()[part], own[part]))
    return fine_pairs(label.numpy()[: x.size].reshape(x.shape), x, y, pixels)


def _cross(result: Correction, image: np.ndarray, pairs: Pairs) -> None:
    """Find the edges between pairs of samples, and correct the pixels."""
    band = result.band
    found, edge = _find(band, pairs)
    if not len(found):
        return
    stretched = found.stretched()
    deposit(image, found.pairs.pixel, found.moved(stretched))
    if stretched.any():
        numbers = take(found, stretched).stretches()
        stretches = Stretches(numbers, found.pairs.pixel[stretched])
        result.stretches.append(stretches)
        _add(image, stretches.pixel, probe.stretches(*band.inputs, Stretch(*band.lanes(*numbers.values()))))
    result.edges.append(Moving(*positions(found.pairs, found.along), found.pairs.pixel, found.change(), edge))


def _find(band: Band, pairs: Pairs) -> tuple[Crossings, dict[str, np.ndarray]]:
    """Edges between pairs of samples, in the order of `Crossings`, and their paths and events."""
    single = band.real is ad.Float
    ulp = float(np.finfo(number(band.real)).eps) * max(band.resolution)
    pair, start, length, label = np.arange(len(pairs)), np.zeros(len(pairs)), pairs.length, pairs.label
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
