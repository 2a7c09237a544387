"""One image to compute, and its derivatives, a band of rows at a time."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import drjit as dr
import numpy as np
from drjit.llvm import ad

from ..core.arrays import Array, Parameters
from ..core.host import opaque_copy, to_lanes
from ..core.pytree import Apart
from ..edges.found import Found
from ..edges.search import correct
from ..edges.settings import LEAST_WEIGHT
from ..sampling import kernels
from ..sampling.band import Band
from ..sampling.differentiated import Gradients
from ..sampling.film import Film
from ..scene.features import branches_out
from ..scene.scene import Scene
from ..scene.structure import Structure
from ..tracing.node import Limits
from ..tracing.record import MOST_NODES, Record

# Samples in a band: enough to keep all cores busy, and few enough to report progress, and to stop,
# between two bands
BAND = 1 << 20
# Nodes that the smallest stack has room for
LEAST_CAPACITY = 8


@dataclass(frozen=True)
class Job:
    """An image of plain samples; its parameters carry no gradients."""

    scene: Scene
    parameters: Apart  # by name
    resolution: tuple[int, int]
    max_depth: int
    side: int  # samples along a pixel's side
    progress: Callable[[float], None] | None
    rows: tuple[int, int] | None = None  # the first row and their number [default: all]
    unroll: int | None = None  # levels of trees in straight code [default: what pays]
    keep: bool = False  # what the derivatives need
    # What rays have met, by the first row of a band
    records: dict[int, Record] = field(default_factory=dict)

    @property
    def limits(self) -> Limits:
        least, real = self.scene.min_importance, self.scene.precision.real
        importance = dr.opaque(real, least) if least > 0 else None
        wanted = self._levels_that_pay() if self.unroll is None else self.unroll
        levels = min(wanted, self.max_depth)
        # Derivatives in reverse mode keep all nodes of a chain. In images of trees, the nodes below
        # the straight levels wait at first, all but one
        most = self.max_depth + (2**levels - 1 - levels if branches_out(self.scene) else 0)
        # A stack's size is compiled in. Powers of two are few
        return Limits(
            capacity=max(LEAST_CAPACITY, 1 << (most - 1).bit_length()),
            depth=dr.opaque(ad.UInt32, self.max_depth),
            importance=importance,
            levels=levels,
            loops=levels < self.max_depth,
        )

    def _levels_that_pay(self) -> int:
        """By measurement: see `tracing.recursion`."""
        if self.scene.structure.in_tree:
            return 0
        return 1 if branches_out(self.scene) else 3

    @property
    def span(self) -> tuple[int, int]:
        """The first row that is computed, and how many they are."""
        return self.rows or (0, self.resolution[1])

    def bands(self) -> Iterator[tuple[int, int]]:
        """First row and rows of each band."""
        start, count = self.span
        rows = max(4, BAND // (self.resolution[0] * self.side**2) // 4 * 4)
        for first in range(start, start + count, rows):
            yield first, min(rows, start + count - first)

    def report(self, row: float) -> None:
        """Report that all is done up to a row."""
        start, count = self.span
        if self.progress is not None:
            self.progress((row - start) / count)

    def band(self, first: int, rows: int) -> Band:
        inputs = self.scene.structure, self.parameters, self.limits
        return Band(*inputs, self.resolution, first, rows, self.side)

    def image(self) -> Array:
        return self._assemble(lambda *rows: [self._pixels(*rows)])[0]

    def _pixels(self, first: int, rows: int) -> Array:
        inputs, samples = self._inputs(first, rows), self.side**2
        all_nodes = self.resolution[0] * self.span[1] * samples * self.max_depth
        if self.keep and self.scene.structure.recorded and all_nodes <= MOST_NODES:
            samples *= inputs[2].lanes
            self.records[first] = Record.of(self.scene.precision, samples, self.max_depth)
        return kernels.image(*inputs, self.records.get(first))

    def tangents(self, wrt: Parameters, directions: Sequence[Parameters]) -> list[Array]:
        """The image's derivatives along some tangents of the parameters `wrt`."""
        own = tuple(_opaque(tangents) for tangents in directions)
        return self._assemble(
            lambda first, rows: self._tangents(first, rows, dict(wrt), own), len(own)
        )

    def _tangents(
        self, first: int, rows: int, wrt: Parameters, directions: tuple[Parameters, ...]
    ) -> Sequence[Array]:
        slopes: Sequence[Array] = kernels.image_jvp(
            *self._inputs(first, rows), tuple(wrt), directions
        )
        return slopes

    def adjoint(self, wrt: Parameters, image: Array) -> Parameters:
        """The derivatives by the parameters `wrt`, from those by the image's pixels."""
        dr.make_opaque(image)
        total: Parameters | None = None
        for first, rows in self.bands():
            at = first - self.span[0]
            part = image.array if rows == image.shape[0] else image[at : at + rows].array
            gradients = self._adjoint(first, rows, dict(wrt), part)
            sums: Parameters = total or dict.fromkeys(gradients, 0)
            total = {name: sums[name] + gradients[name] for name in gradients}
        return total or {}

    def _adjoint(self, first: int, rows: int, wrt: Parameters, part: Array) -> Parameters:
        record = self.records.get(first)
        inputs, names = self._inputs(first, rows), tuple(wrt)
        found: Gradients = kernels.image_vjp(*inputs, names, part, None, record)
        return found.by_name(self.scene.structure, names)

    def _inputs(self, first: int, rows: int) -> tuple[Structure, Apart, Film, Limits]:
        band = self.band(first, rows)
        return band.structure, band.parameters, band.inner, band.limits

    def _assemble(
        self, kernel: Callable[[int, int], Sequence[Array]], images: int = 1
    ) -> list[Array]:
        """The bands' pixels in some images, each as one tensor."""
        width, (start, count) = self.resolution[0], self.span
        precision = self.scene.precision
        whole: list[Array] = []
        for first, rows in self.bands():
            bands = kernel(first, rows)
            if rows == count:
                whole = list(bands)
            else:
                if first == start:
                    # Without enough memory NumPy raises an error; Dr.Jit would end the process
                    np.empty(images * count * width * 3, precision.dtype)
                    whole = [dr.empty(precision.real, count * width * 3) for _ in range(images)]
                place = slice((first - start) * width * 3, (first - start + rows) * width * 3)
                for image, pixels in zip(whole, bands, strict=True):
                    image.numpy()[place] = pixels.numpy()
            if self.progress is not None:
                dr.sync_thread()
                self.report(first + rows)
        return [precision.tensor(image, (count, width, 3)) for image in whole]


def _opaque(tangents: Parameters) -> Parameters:
    return {name: opaque_copy(value) for name, value in tangents.items()}


@dataclass(frozen=True)
class BoundaryJob(Job):
    """An image with its edges; what is known of them is kept for the derivatives."""

    terms: str = "both"
    # By the first row of a band
    found: dict[int, list[Found]] = field(default_factory=dict)

    @property
    def limits(self) -> Limits:
        faint = dr.opaque(self.scene.precision.real, LEAST_WEIGHT / self.side**2)
        return replace(super().limits, faint=faint)

    def _levels_that_pay(self) -> int:
        """None: of the kernels for edges, images take a small part of the time."""
        return 0

    def image(self) -> Array:
        return self._assemble(self._correct)[0]

    def _correct(self, first: int, rows: int) -> list[Array]:
        stop = sum(self.span)

        def report(fraction: float) -> None:
            if first + fraction * rows < stop:
                self.report(first + fraction * rows)

        # Edges are found by derivatives of their own
        with dr.resume_grad():
            pixels, self.found[first] = correct(self.band(first, rows), self.keep, report)
        return [pixels]

    def _tangents(
        self, first: int, rows: int, wrt: Parameters, directions: tuple[Parameters, ...]
    ) -> Sequence[Array]:
        parts = [
            found.correction.tangents(wrt, directions, self.terms) for found in self.found[first]
        ]
        return parts[0] if len(parts) == 1 else [dr.concat(own) for own in zip(*parts, strict=True)]

    def _adjoint(self, first: int, rows: int, wrt: Parameters, part: Array) -> Parameters:
        parts, start = [], 0
        for found in self.found[first]:
            pixels = part
            if len(self.found[first]) > 1:
                stop = start + 3 * found.band.rows * found.band.resolution[0]
                pixels, start = to_lanes(part.numpy()[start:stop]), stop
            parts.append(found.correction.adjoint(wrt, pixels, self.terms))
        return {name: sum(gradients[name] for gradients in parts) for name in wrt}
