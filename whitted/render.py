"""From a scene to an image, as one differentiable operation.

The image comes from a plain kernel, and its derivatives from kernels that trace again with gradients, so that nothing
of the trees of rays is stored in between. Large images are rendered a band of rows at a time.
"""

import math
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import drjit as dr
import numpy as np
from drjit.llvm import ad

from . import wavefront
from .boundary import correct
from .correction import TERMS, Found
from .film import Film, band
from .geometry import Array
from .region import FAINT, Band
from .scene import MAX_DEPTH, Scene, Shape
from .trace import Limits

# Samples in a band: enough to keep all cores busy, few enough to report progress and to stop between two of them
BAND = 1 << 22
MAX_SPP = 1 << 16
# Dr.Jit's frozen functions cannot be entered by two threads at once; derivatives are for one thread at a time, as Dr.Jit's
# own work on them in another thread can wait for what waits for it
LOCK = threading.RLock()


def render(
    scene: Scene,
    spp: int = 1,
    *,
    boundary: bool = True,
    terms: str = "both",
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Array:
    """Render a scene, differentiably in the parameters that `Scene.replace` gave it.

    Args:
        spp: samples a pixel, a perfect square n * n; they sit on a regular n x n grid.
        boundary: find the edges between samples, which corrects the pixels and adds to the derivatives what moving
            edges contribute; False gives plain samples and their derivatives, which miss it.
        terms: of the derivatives: "both", or only the "interior" or the "boundary" term of their sum.
        max_depth: nodes on the longest chain of rays, in place of the scene's.
        resolution: width and height in pixels, in place of the scene's.
        progress: called with the fraction done, in (0, 1], after each band of rows.

    Returns:
        Linear RGB radiance, a `TensorXf` (`TensorXf64` in double precision) of shape (height, width, 3).

    Raises:
        ValueError: an argument is out of range, or the image does not fit in memory.
    """
    if terms not in TERMS or (terms != "both" and not boundary):
        raise ValueError(f"terms: expected one of {', '.join(TERMS)}, with boundary=True, got {terms!r}")
    side = math.isqrt(spp) if _whole(spp, 1, MAX_SPP) else 0
    if side * side != spp or not side:
        raise ValueError(f"spp: expected a perfect square (1, 4, 9, 16, ...) up to {MAX_SPP}, got {spp!r}")
    if max_depth is not None and not _whole(max_depth, 1, MAX_DEPTH):
        raise ValueError(f"max_depth: expected a whole number from 1 to {MAX_DEPTH}, got {max_depth!r}")
    width, height = _resolution(scene.resolution if resolution is None else resolution)
    _check_memory(width, height, dr.itemsize_v(scene.background))
    parameters = scene.parameters()
    # A value that is part of the code would be a kernel of its own
    dr.make_opaque(parameters)
    wrt = {name: value for name, value in parameters.items() if dr.grad_enabled(value)}
    still = dr.detach(parameters) if wrt else parameters
    size, depth = (width, height), max_depth or scene.max_depth
    job: _Job = _Job(scene, still, size, depth, side, progress)
    if boundary:
        job = _BoundaryJob(scene, still, size, depth, side, progress, terms, keep=bool(wrt))
    with LOCK:
        # Within a function Dr.Jit does not look for arrays, of which only those in `wrt` are inputs
        return dr.custom(_Render, wrt, lambda: job) if wrt else job.image()


def _whole(value: object, low: int, high: int) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and bool(low <= value <= high)


def _resolution(resolution: object) -> tuple[int, int]:
    pair = tuple(resolution) if isinstance(resolution, (tuple, list)) else ()
    if len(pair) != 2 or not all(_whole(n, 1, 1 << 20) for n in pair):
        raise ValueError(f"resolution: expected (width, height), two whole numbers of pixels > 0, got {resolution!r}")
    return int(pair[0]), int(pair[1])


def _check_memory(width: int, height: int, size: int) -> None:
    need, have = width * height * 3 * size, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if need > have / 2 or width * height * 3 >= 1 << 32:
        gib = 1 << 30
        raise ValueError(f"resolution: an image of {width} x {height} takes {need / gib:.1f} GiB, too much; use a smaller one")


class _Render(dr.CustomOp):
    """The image as one node of Dr.Jit's computation graph."""

    def eval(self, wrt, job):
        self.wrt, self.job = wrt, job()
        return self.job.image()

    def forward(self):
        self.set_grad_out(self.job.tangent(self.wrt, self.grad_in("wrt")))

    def backward(self):
        self.set_grad_in("wrt", self.job.adjoint(self.wrt, self.grad_out()))


@dataclass(frozen=True)
class _Job:
    """One image to compute; its parameters carry no gradients."""

    scene: Scene
    parameters: dict[str, Array]
    resolution: tuple[int, int]
    max_depth: int
    side: int
    progress: Callable[[float], None] | None

    @property
    def limits(self) -> Limits:
        scene = self.scene
        importance = dr.opaque(type(scene.camera.fov), scene.min_importance) if scene.min_importance > 0 else None
        return Limits(self.max_depth, dr.opaque(ad.UInt32, self.max_depth), importance)

    def bands(self) -> Iterator[tuple[int, int]]:
        """First row and rows of each band."""
        width, height = self.resolution
        rows = max(4, BAND // (width * self.side**2) // 4 * 4)
        for first in range(0, height, rows):
            yield first, min(rows, height - first)

    def image(self) -> Array:
        return self._assemble(lambda *rows: wavefront.image(*self._inputs(*rows)))

    def tangent(self, wrt: dict, tangents: dict) -> Array:
        dr.make_opaque(tangents)
        return self._assemble(lambda *rows: wavefront.image_jvp(*self._inputs(*rows), dict(wrt), dict(tangents)))

    def adjoint(self, wrt: dict, image: Array) -> dict:
        dr.make_opaque(image)
        total: dict | None = None
        for first, rows in self.bands():
            part = image.array if rows == image.shape[0] else image[first : first + rows].array
            gradients = self._adjoint(first, rows, dict(wrt), part)
            total = gradients if total is None else {name: total[name] + gradients[name] for name in total}
        return total or {}

    def _adjoint(self, first: int, rows: int, wrt: dict, part: Array) -> dict:
        return wavefront.image_vjp(*self._inputs(first, rows), wrt, part)

    def _inputs(self, first: int, rows: int) -> tuple[Shape, dict[str, Array], Film, Limits]:
        film = band(self.resolution, first, rows, self.side, type(self.scene.camera.fov))
        return self.scene.shape, self.parameters, film, self.limits

    def _assemble(self, kernel: Callable[[int, int], Array]) -> Array:
        """The bands' pixels as one tensor."""
        width, height = self.resolution
        single = type(self.scene.camera.fov) is ad.Float
        whole: Array = None
        for first, rows in self.bands():
            pixels = kernel(first, rows)
            if rows < height:
                whole = np.empty(height * width * 3, np.float32 if single else np.float64) if first == 0 else whole
                whole[first * width * 3 : (first + rows) * width * 3] = pixels.numpy()
            else:
                whole = pixels
            if self.progress is not None:
                dr.sync_thread()
                self.progress((first + rows) / height)
        return (ad.TensorXf if single else ad.TensorXf64)((ad.Float if single else ad.Float64)(whole), (height, width, 3))


@dataclass(frozen=True)
class _BoundaryJob(_Job):
    """One image with its edges; what is known of them is kept for the derivatives."""

    terms: str = "both"
    keep: bool = False
    found: dict[int, Found] = field(default_factory=dict)

    @property
    def limits(self) -> Limits:
        return replace(super().limits, faint=dr.opaque(type(self.scene.camera.fov), FAINT / self.side**2))

    def image(self) -> Array:
        return self._assemble(self._correct)

    def _correct(self, first: int, rows: int) -> Array:
        band = Band(self.scene.shape, self.parameters, self.limits, self.resolution, first, rows, self.side)
        # Edges are found by derivatives of their own
        with dr.resume_grad():
            pixels, found = correct(band, self.keep)
        if found is not None:
            self.found[first] = found
        return pixels

    def tangent(self, wrt: dict, tangents: dict) -> Array:
        dr.make_opaque(tangents)
        return self._assemble(lambda first, _: self.found[first].correction.tangent(dict(wrt), dict(tangents), self.terms))

    def _adjoint(self, first: int, rows: int, wrt: dict, part: Array) -> dict:
        return self.found[first].correction.adjoint(wrt, part, self.terms)
