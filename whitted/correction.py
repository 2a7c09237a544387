"""What edges add to a band's pixels, kept for the derivatives of those: in forward and in reverse mode."""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from functools import partial

import drjit as dr
import numpy as np
from drjit.llvm import ad

from . import probe, wavefront
from .chain import Path
from .derivative import Edge
from .edges import deposit, joined, take
from .events import Event
from .geometry import Array
from .quadrature import Stretch
from .region import LANES, Band, aligned, chunks, lanes, number, rows
from .scene import Shape
from .trace import Limits

# Names of the fields of an edge's path and event
PARTS = tuple(tuple(part.name for part in fields(kind)) for kind in (Path, Event))
TERMS = ("both", "interior", "boundary")


@dataclass(frozen=True)
class Finer:
    """Samples in pixels that were sampled anew."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray
    weight: np.ndarray  # what the sample counts for in its pixel


@dataclass(frozen=True)
class Stretches:
    """Samples beside singular edges, by the fields of `quadrature.Stretch`."""

    numbers: dict[str, np.ndarray]
    pixel: np.ndarray  # (2, N)


@dataclass(frozen=True)
class Moving:
    """Points on edges, each with what it changes in two pixels when the level function there grows."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray  # (2, N)
    change: np.ndarray  # (2, N), in units of the jump
    jump: np.ndarray  # (3, N)
    edge: dict[str, np.ndarray]


@dataclass
class Correction:
    """What makes a band's pixels those of its regular samples and edges, and not of the samples alone."""

    band: Band
    weights: Array | None = None  # what the band's regular samples still count for, row by row of samples
    finer: list[Finer] = field(default_factory=list)
    stretches: list[Stretches] = field(default_factory=list)
    edges: list[Moving] = field(default_factory=list)

    def fine(self) -> Iterator[Finer]:
        """The finer samples, no more at once than a kernel takes."""
        if self.finer:
            whole = joined(self.finer)
            yield from (take(whole, np.arange(part.start, part.stop)) for part in chunks(len(whole.x), LANES))

    def tangent(self, wrt: dict, tangents: dict, terms: str) -> Array:
        """The pixels' derivative along the tangents of the parameters `wrt`."""
        band = self.band
        if terms != "boundary":
            inputs = band.shape, band.parameters, band.inner, band.limits, wrt, tangents
            pixels = wavefront.image_jvp(*inputs, self.weights)
            image = pixels.numpy()
            for fine in self.fine():
                slope = probe.samples_jvp(*band.inputs, wrt, tangents, *band.lanes(fine.x, fine.y))
                deposit(image, fine.pixel, *(rows(slope, slice(len(fine.x))) * fine.weight))
            for stretches in self.stretches:
                stretch = Stretch(*band.lanes(*stretches.numbers.values()))
                both = probe.stretches_jvp(*_beside(band, wrt), wrt, tangents, stretch)
                for pixel, slope in zip(stretches.pixel, both, strict=True):
                    deposit(image, pixel, *rows(slope, slice(len(pixel))))
        else:
            pixels = aligned(np.zeros(1, number(band.real)), band.rows * band.resolution[0] * 3)
            image = pixels.numpy()
        if terms != "interior":
            for edges in self.edges:
                x, y = band.lanes(edges.x, edges.y)
                slope = probe.levels_jvp(*band.inputs, wrt, tangents, x, y, _edge(edges.edge)).numpy()[: len(edges.x)]
                deposit(image, edges.pixel, *(edges.change * (channel * slope) for channel in edges.jump))
        return pixels

    def adjoint(self, wrt: dict, image: Array, terms: str) -> dict:
        """The derivatives of dot(image, pixels) by the parameters `wrt`."""
        band, calls = self.band, []
        # All inputs come first: making one waits for the kernels before it
        if terms != "boundary":
            inputs = band.shape, band.parameters, band.inner, band.limits, wrt, image
            calls.append(partial(wavefront.image_vjp, *inputs, self.weights))
            for fine in self.fine():
                sample = band.lanes(_unsigned(fine.pixel), fine.weight, fine.x, fine.y)
                calls.append(partial(probe.samples_vjp, *band.inputs, wrt, image, *sample))
            for stretches in self.stretches:
                stretch = Stretch(*band.lanes(*stretches.numbers.values()))
                pixels = band.lanes(*_unsigned(stretches.pixel))
                calls.append(partial(probe.stretches_vjp, *_beside(band, wrt), wrt, image, stretch, *pixels))
        if terms != "interior":
            for edges in self.edges:
                changed = ad.Array2u(*band.lanes(*_unsigned(edges.pixel)))
                change = type(band.inner.size)(*band.lanes(*edges.change))
                place = band.lanes(edges.x, edges.y)
                moving = changed, change, band.color(edges.jump), *place, _edge(edges.edge)
                calls.append(partial(probe.levels_vjp, *band.inputs, wrt, image, *moving))
        parts = [call() for call in calls]
        return {name: sum((part[name] for part in parts), start=dr.zeros(type(value))) for name, value in wrt.items()}


def _beside(band: Band, wrt: dict) -> tuple[Shape, dict[str, Array], Array, Limits]:
    """The inputs of samples beside edges; derivatives by a weight need rays that have little of it, or none."""
    return band.inputs if any(name.endswith((".reflection", ".refraction")) for name in wrt) else band.beside


def _unsigned(pixel: np.ndarray) -> np.ndarray:
    """Pixels as kernels take them: -1 becomes `probe.NOWHERE`."""
    return pixel.astype(np.uint32)


def _edge(numbers: dict[str, np.ndarray]) -> Edge:
    """The Dr.Jit arrays of `numbers_of`."""
    path, event = ({name: lanes(numbers[name]) for name in names} for names in PARTS)
    return Edge(Path(**path), Event(**event))


def numbers_of(edge: Edge, which: np.ndarray) -> dict[str, np.ndarray]:
    """Some of the edges, by the fields of their paths and events."""
    return {name: value.numpy()[which] for part in (edge.path, edge.event) for name, value in vars(part).items()}
