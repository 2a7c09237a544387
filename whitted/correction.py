"""What edges add to a band's pixels, kept for the derivatives of those: in forward and in reverse mode."""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields

import drjit as dr
import numpy as np

from . import probe, wavefront
from .chain import Path
from .derivative import Edge
from .edges import deposit, fine_positions
from .events import Event
from .geometry import Array
from .quadrature import Stretch
from .region import LANES, Band, aligned, chunks, columns, lanes, number

TERMS = ("both", "interior", "boundary")


@dataclass(frozen=True)
class Finer:
    """Pixels with finer samples."""

    pixels: np.ndarray
    side: int
    weights: np.ndarray  # (N, side, side): what the samples still count for in their pixel

    def parts(self, band: Band) -> Iterator[tuple[np.ndarray, ...]]:
        """Positions, pixels and weights of no more samples than a kernel takes."""
        for part in chunks(len(self.pixels), max(1, LANES // self.side**2)):
            pixels = self.pixels[part]
            x, y = fine_positions(pixels, band.resolution[0], self.side, band.first_row)
            positions = x[:, 1:-1, 1:-1].ravel(), y[:, 1:-1, 1:-1].ravel()
            yield *positions, np.repeat(pixels, self.side**2), self.weights[part].reshape(-1, 1)


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
    finer: list[Finer] = field(default_factory=list)
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
        image: np.ndarray = np.zeros((band.rows * band.resolution[0], 3), number(band.real))
        if terms != "boundary":
            inputs = band.shape, band.parameters, band.film(0), band.limits, wrt, tangents
            image[:] = wavefront.image_jvp(*inputs, self.sample_weights()).numpy().reshape(-1, 3)
            self.weigh_pixels(image)
            for x, y, pixel, weight in (part for finer in self.finer for part in finer.parts(band)):
                slope = probe.samples_jvp(*band.inputs, wrt, tangents, *band.lanes(x, y))
                deposit(image, pixel, columns(slope, len(x)) * weight)
            for stretches in self.stretches:
                stretch = Stretch(*band.lanes(*stretches.numbers.values()))
                add(image, stretches.pixel, probe.stretches_jvp(*band.inputs, wrt, tangents, stretch))
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
            for x, y, pixel, weight in (part for finer in self.finer for part in finer.parts(band)):
                parts.append(probe.samples_vjp(*band.inputs, wrt, band.color(seeds[pixel] * weight), *band.lanes(x, y)))
            for stretches in self.stretches:
                stretch = Stretch(*band.lanes(*stretches.numbers.values()))
                both = (band.color(seeds[stretches.pixel[:, k]]) for k in (0, 1))
                parts.append(probe.stretches_vjp(*band.inputs, wrt, stretch, *both))
        if terms != "interior":
            for edges in self.edges:
                seed = (seeds[edges.pixel] * edges.change).sum((1, 2))
                seed, x, y = band.lanes(seed, edges.x, edges.y)
                parts.append(probe.levels_vjp(*band.inputs, wrt, seed, x, y, _edge(edges.edge)))
        return {name: sum((part[name] for part in parts), start=dr.zeros(type(value))) for name, value in wrt.items()}


def add(image: np.ndarray, pixel: np.ndarray, both: tuple[Array, Array]) -> None:
    """Add to the pixels of a and of b."""
    deposit(image, pixel, np.stack([columns(value, len(pixel)) for value in both], 1))


def _edge(numbers: dict[str, np.ndarray]) -> Edge:
    """The Dr.Jit arrays of `_numbers`."""
    arrays = {name: lanes(value) for name, value in numbers.items()}
    path, event = ({f.name: arrays[f.name] for f in fields(kind)} for kind in (Path, Event))
    return Edge(Path(**path), Event(**event))


def numbers_of(edge: Edge, which: np.ndarray) -> dict[str, np.ndarray]:
    """Some of the edges, by the fields of their paths and events."""
    return {name: value.numpy()[which] for part in (edge.path, edge.event) for name, value in vars(part).items()}
