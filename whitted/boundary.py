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
from dataclasses import dataclass, field, replace

import drjit as dr
import numpy as np
from drjit.llvm import ad

from . import probe, wavefront
from .crossing import Crossing, Segment
from .derivative import Edge
from .edges import Crossings, Pairs, busy_pixels, dense_pairs, deposit, fine_pairs, fine_positions, nodes, positions, tilted
from .events import NOTHING
from .film import Film, band
from .geometry import Array
from .scene import Shape
from .trace import Limits

TERMS = ("both", "interior", "boundary")
# Samples along the side of a pixel in which edges meet, for each sample of the others
REFINEMENT = 4
# Searches for edges in what is left of a segment
ROUNDS = 3
# Most lanes of one call of a kernel: those of derivatives keep all parameters' derivatives for each lane
LOOKS = 1 << 20
DERIVATIVES = 1 << 17
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
    def ulp(self) -> float:
        """The spacing of numbers at the largest image position."""
        return float(np.finfo(np.float32 if self.real is ad.Float else np.float64).eps) * max(self.resolution)

    def film(self, margin: int) -> Film:
        return band(self.resolution, self.first_row, self.rows, self.side, self.real, margin)

    @property
    def inputs(self) -> tuple:
        """What all kernels of `probe` take first."""
        return self.shape, self.parameters, self.film(0).size, self.limits

    def lanes(self, *arrays: np.ndarray) -> list[Array]:
        """Dr.Jit arrays of whole packets: kernels want more than one lane. The last element fills them up."""
        return [(ad.Bool if array.dtype == bool else self.real)(array[packets(len(array))]) for array in arrays]

    def look(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Radiance, shape (N, 3), and labels at image positions."""
        colors, labels = np.empty((len(x), 3)), np.empty(len(x), np.uint32)
        for part in chunks(len(x), LOOKS):
            color, label = probe.samples(*self.inputs, *self.lanes(x[part], y[part]))
            n = part.stop - part.start
            colors[part], labels[part] = color.numpy().T[:n], label.numpy()[:n]
        return colors, labels


def packets(n: int) -> np.ndarray:
    """0, 1, ... n - 1 and n - 1 again to the end of the packet."""
    return np.minimum(np.arange(-(-n // PACKET) * PACKET), n - 1)


def chunks(n: int, size: int) -> Iterator[slice]:
    for first in range(0, n, size):
        yield slice(first, min(first + size, n))


@dataclass(frozen=True)
class Samples:
    """Samples, each with its weights in two pixels; pixel -1 takes nothing."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray  # (N, 2)
    weight: np.ndarray  # (N, 2)


@dataclass(frozen=True)
class Moving:
    """Points on edges, each with what it changes in two pixels when the level function there grows."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray  # (N, 2)
    change: np.ndarray  # (N, 2, 3)
    edge: Edge  # as wide as whole packets


@dataclass(frozen=True)
class Correction:
    """What makes a band's pixels those of its regular samples and edges, and not of the samples alone."""

    band: Band
    busy: np.ndarray  # pixels that have finer samples in place of the regular ones
    samples: list[Samples] = field(default_factory=list)
    edges: list[Moving] = field(default_factory=list)

    def tangent(self, wrt: dict, tangents: dict, terms: str) -> Array:
        """The pixels' derivative along the tangents of the parameters `wrt`."""
        band = self.band
        image = np.zeros((band.rows * band.resolution[0], 3))
        if terms != "boundary":
            flat = wavefront.image_jvp(band.shape, band.parameters, band.film(0), band.limits, wrt, tangents)
            image[:] = flat.numpy().reshape(-1, 3)
            image[self.busy] = 0
            for samples in self.samples:
                for part in chunks(len(samples.x), LOOKS):
                    x, y = band.lanes(samples.x[part], samples.y[part])
                    slope = probe.samples_jvp(*band.inputs, wrt, tangents, x, y).numpy().T[: part.stop - part.start]
                    deposit(image, samples.pixel[part], samples.weight[part, :, None] * slope[:, None])
        if terms != "interior":
            for edges in self.edges:
                x, y = band.lanes(edges.x, edges.y)
                slope = probe.levels_jvp(*band.inputs, wrt, tangents, x, y, edges.edge).numpy()[: len(edges.x)]
                deposit(image, edges.pixel, edges.change * slope[:, None, None])
        return band.real(image.ravel())

    def adjoint(self, wrt: dict, image: Array, terms: str) -> dict:
        """The derivatives of dot(image, pixels) by the parameters `wrt`."""
        band, parts = self.band, []
        weights = np.asarray(image.numpy(), np.float64).reshape(-1, 3)
        if terms != "boundary":
            plain = weights.copy()
            plain[self.busy] = 0
            plain = band.real(plain.ravel())
            parts.append(wavefront.image_vjp(band.shape, band.parameters, band.film(0), band.limits, wrt, plain))
            for samples in self.samples:
                for part in chunks(len(samples.x), DERIVATIVES):
                    pixel, weight = samples.pixel[part], samples.weight[part]
                    seed = (_gathered(weights, pixel) * weight[:, :, None]).sum(1)
                    x, y, *seed = band.lanes(samples.x[part], samples.y[part], *seed.T)
                    seed = _ending(type(band.shape.scene.background)(*seed), len(pixel))
                    parts.append(probe.samples_vjp(*band.inputs, wrt, seed, x, y))
        if terms != "interior":
            for edges in self.edges:
                seed = (_gathered(weights, edges.pixel) * edges.change).sum((1, 2))
                x, y, seed = band.lanes(edges.x, edges.y, seed)
                parts.append(probe.levels_vjp(*band.inputs, wrt, _ending(seed, len(edges.x)), x, y, edges.edge))
        return {name: sum((part[name] for part in parts), start=dr.zeros(type(value))) for name, value in wrt.items()}


def _gathered(image: np.ndarray, pixel: np.ndarray) -> np.ndarray:
    return np.where(pixel[..., None] >= 0, image[pixel], 0)


def _ending(array: Array, n: int) -> Array:
    """The array with zeros from element n on."""
    array = dr.select(dr.arange(ad.UInt32, dr.width(array)) < dr.opaque(ad.UInt32, n), array, 0)
    dr.eval(array)
    return array


def correct(band: Band) -> tuple[Array, Correction]:
    """A band's pixels, row-major with RGB interleaved, and what their derivatives need."""
    flat, labels = wavefront.labelled_image(band.shape, band.parameters, band.film(1), band.limits)
    width, side = band.resolution[0], band.side
    labels = labels.numpy().reshape((band.rows + 2) * side, (width + 2) * side)
    pixels = np.array(flat.numpy(), np.float64).reshape(-1, 3)
    pairs = dense_pairs(labels, side, band.first_row)
    touched = np.zeros(len(pixels) + 1, bool)
    touched[pairs.pixel] = True
    result = Correction(band, busy_pixels(labels, side, np.flatnonzero(touched[:-1])))

    # Busy pixels are done apart
    touched[:] = False
    touched[result.busy] = True
    pairs = replace(pairs, pixel=np.where(touched[pairs.pixel], -1, pairs.pixel))
    _cross(result, pixels, pairs.take((pairs.pixel >= 0).any(1)))
    for part in chunks(len(result.busy), max(1, LOOKS // (REFINEMENT * side + 2) ** 2)):
        _refine(result, pixels, result.busy[part])
    return band.real(pixels.ravel()), result


def _refine(result: Correction, image: np.ndarray, pixels: np.ndarray) -> None:
    """Sample pixels anew, more finely."""
    band, side = result.band, REFINEMENT * result.band.side
    x, y = fine_positions(pixels, band.resolution[0], side, band.first_row)
    colors, labels = band.look(x.ravel(), y.ravel())
    inner = (slice(None), slice(1, -1), slice(1, -1))
    image[pixels] = colors.reshape(*x.shape, 3)[inner].mean((1, 2))
    pixel = np.stack([np.repeat(pixels, side**2), np.full(len(pixels) * side**2, -1)], 1)
    result.samples.append(Samples(x[inner].ravel(), y[inner].ravel(), pixel, np.where(pixel >= 0, side**-2.0, 0)))
    _cross(result, image, fine_pairs(labels.reshape(x.shape), x, y, pixels))


def _cross(result: Correction, image: np.ndarray, pairs: Pairs) -> None:
    for part in chunks(len(pairs), DERIVATIVES):
        _cross_part(result, image, pairs.take(part))


def _cross_part(result: Correction, image: np.ndarray, pairs: Pairs) -> None:
    """Find the edges between pairs of samples, and correct the pixels."""
    found, edges = _find(result.band, pairs)
    if not edges:
        return
    order = np.lexsort((found.along, found.pair))
    found = found.take(order)
    distance, weight = nodes(found)
    x, y = positions(found.pairs, distance)
    used = (weight != 0).any(2)
    colors = np.zeros((*x.shape, 3))
    colors[used], _ = result.band.look(x[used], y[used])
    pixel = np.broadcast_to(found.pairs.pixel[:, None], weight.shape)
    result.samples.append(Samples(x[used], y[used], pixel[used], weight[used]))
    smooth = np.einsum("nmk,nmc->nkc", weight, colors)
    deposit(image, found.pairs.pixel, smooth + tilted(found)[:, :, None] * found.jump[:, None])

    # Back in the order in which they were found, which is that of their events
    x, y = positions(found.pairs, found.along)
    change = found.change
    place = np.argsort(order)
    for part, edge in zip(np.split(place, np.cumsum([n for n, _ in edges])[:-1]), (edge for _, edge in edges), strict=True):
        result.edges.append(Moving(x[part], y[part], found.pairs.pixel[part], change[part], edge))


def _find(band: Band, pairs: Pairs) -> tuple[Crossings, list[tuple[int, Edge]]]:
    """Edges between pairs of samples, and their events in groups, each with its size."""
    pair, start, length, label = np.arange(len(pairs)), np.zeros(len(pairs)), pairs.length, pairs.label
    crossings, edges = [], []
    for _ in range(ROUNDS):
        if not len(pair):
            break
        x, y = positions(pairs.take(pair), start)
        crossing = probe.crossings(*band.inputs, Segment(*band.lanes(x, y, pairs.vertical[pair], length)))
        t, slope, across, valid = _numbers(crossing, len(pair))
        pair, start, length, label = pair[valid], start[valid], length[valid], label[valid]
        here, along = pairs.take(pair), start + t * length

        # Radiance and labels right before and right behind the edge
        gap = np.maximum(here.length * (2.0**-10 if band.real is ad.Float else 1e-6), 8 * band.ulp)
        x, y = positions(here, np.stack([along - gap, along + gap], 1))
        colors, sides = band.look(x.ravel(), y.ravel())
        colors, sides = colors.reshape(-1, 2, 3), sides.reshape(-1, 2)
        real = np.flatnonzero(sides[:, 0] != sides[:, 1])
        found = Crossings(here, pair, along, slope, across, colors[:, 0] - colors[:, 1])
        crossings.append(found.take(real))
        if len(real):
            edge = dr.gather(Edge, crossing.edge, ad.UInt32(valid[real][packets(len(real))]))
            dr.eval(edge)
            edges.append((len(real), edge))

        # What is left of the segment on either side
        before, behind = along - gap - start, start + length - along - gap
        left = np.flatnonzero((sides[:, 0] != label[:, 0]) & (before > gap))
        right = np.flatnonzero((sides[:, 1] != label[:, 1]) & (behind > gap))
        ends = np.stack([label[left, 0], sides[left, 0]], 1), np.stack([sides[right, 1], label[right, 1]], 1)
        pair, label = np.concatenate([pair[left], pair[right]]), np.concatenate(ends)
        start = np.concatenate([start[left], (along + gap)[right]])
        length = np.concatenate([before[left], behind[right]])
    return Crossings.joined(crossings), edges


def _numbers(crossing: Crossing, n: int) -> tuple[np.ndarray, ...]:
    """The place and the slopes of crossings that were found, and which those are."""
    numbers = np.array([value.numpy()[:n] for value in (crossing.t, crossing.slope, crossing.across)], np.float64)
    valid = (crossing.edge.event.kind.numpy()[:n] != NOTHING) & np.isfinite(numbers).all(0) & (numbers[1] != 0)
    return *numbers[:, valid], np.flatnonzero(valid)
