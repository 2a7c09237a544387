"""From a scene to an image: every sample of every pixel, and the derivatives of all of it.

`render` is one differentiable operation: the image comes from a plain kernel, and its derivatives from kernels that
trace again with gradients (`derivative.py`), so that nothing of the trees of rays is stored in between. Each runs in
a frozen function, which skips tracing the Python code when a scene of the same shape is rendered again.
"""

import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import drjit as dr
import numpy as np
from drjit.llvm import ad

from .camera import View, view
from .derivative import push_forward, radiance_jvp, radiance_vjp
from .film import Film, band, next_sample, pixel, sample_ray
from .geometry import Array
from .scene import Scene, Shape
from .trace import Limits, radiance

MAX_DEPTH = 256
# Samples in a band: enough to keep all cores busy, few enough to report progress and to stop between two of them
BAND = 1 << 22
# Lanes of the reverse kernel: each takes many pixels, so that little is left to sum
REVERSE_LANES = 1 << 14


def render(
    scene: Scene,
    spp: int = 1,
    *,
    boundary: bool = False,
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Array:
    """Render a scene, differentiably in the parameters that `Scene.replace` gave it.

    Args:
        spp: samples a pixel, a perfect square n * n; they sit on a regular n x n grid.
        boundary: must be False: what edges contribute when they move is not in this version.
        max_depth: nodes on the longest chain of rays, in place of the scene's.
        resolution: width and height in pixels, in place of the scene's.
        progress: called with the fraction done, in (0, 1], after each band of rows.

    Returns:
        Linear RGB radiance, a `TensorXf` (`TensorXf64` in double precision) of shape (height, width, 3).

    Raises:
        ValueError: an argument is out of range, or the image does not fit in memory.
    """
    if boundary:
        raise ValueError("boundary=True: this version has no boundary term; pass boundary=False")
    side = math.isqrt(spp) if _whole(spp, 1, 1 << 20) else 0
    if side * side != spp or not side:
        raise ValueError(f"spp: expected a perfect square (1, 4, 9, 16, ...) up to {1 << 20}, got {spp!r}")
    if max_depth is not None and not _whole(max_depth, 1, MAX_DEPTH):
        raise ValueError(f"max_depth: expected a whole number from 1 to {MAX_DEPTH}, got {max_depth!r}")
    scene = replace(scene, max_depth=max_depth or scene.max_depth, resolution=_resolution(resolution or scene.resolution))
    _check_memory(scene)
    parameters = scene.parameters()
    wrt = {name: value for name, value in parameters.items() if dr.grad_enabled(value)}
    job = _Job(scene, dr.detach(parameters), side, progress)
    return dr.custom(_Render, wrt, job) if wrt else job.image()


def _whole(value: object, low: int, high: int) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and low <= value <= high


def _resolution(resolution: object) -> tuple[int, int]:
    pair = tuple(resolution) if isinstance(resolution, (tuple, list)) else ()
    if len(pair) != 2 or not all(_whole(n, 1, 1 << 20) for n in pair):
        raise ValueError(f"resolution: expected (width, height), two whole numbers of pixels > 0, got {resolution!r}")
    return int(pair[0]), int(pair[1])


def _check_memory(scene: Scene) -> None:
    width, height = scene.resolution
    need, have = width * height * 3 * dr.itemsize_v(scene.background), os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if need > have / 2 or width * height * 3 >= 1 << 32:
        gib = 1 << 30
        raise ValueError(f"resolution: an image of {width} x {height} takes {need / gib:.1f} GiB, too much; use a smaller one")


class _Render(dr.CustomOp):
    """The image as one node of Dr.Jit's computation graph."""

    def eval(self, wrt, job):
        self.wrt, self.job = wrt, job
        return job.image()

    def forward(self):
        self.set_grad_out(self.job.tangent(self.wrt, self.grad_in("wrt")))

    def backward(self):
        self.set_grad_in("wrt", self.job.adjoint(self.wrt, self.grad_out()))


@dataclass(frozen=True)
class _Job:
    """One image to compute; its parameters carry no gradients."""

    scene: Scene
    parameters: dict[str, Array]
    side: int
    progress: Callable[[float], None] | None

    @property
    def limits(self) -> Limits:
        scene = self.scene
        importance = dr.opaque(type(scene.camera.fov), scene.min_importance) if scene.min_importance > 0 else None
        return Limits(scene.max_depth, dr.opaque(ad.UInt32, scene.max_depth), importance)

    def bands(self) -> Iterator[tuple[int, int, Film]]:
        """First row, rows, and film of each band."""
        width, height = self.scene.resolution
        rows = max(4, BAND // (width * self.side**2) // 4 * 4)
        for first in range(0, height, rows):
            count = min(rows, height - first)
            yield first, count, band((width, height), first, count, self.side, type(self.scene.camera.fov))

    def image(self) -> Array:
        return self._assemble(lambda film: _image(self.scene.shape, self.parameters, film, self.limits))

    def tangent(self, wrt: dict, tangents: dict) -> Array:
        return self._assemble(lambda film: _tangent(self.scene.shape, self.parameters, film, self.limits, dict(wrt), dict(tangents)))

    def adjoint(self, wrt: dict, image: Array) -> dict:
        total = None
        for first, rows, film in self.bands():
            part = image.array if rows == image.shape[0] else image[first : first + rows].array
            gradients = _adjoint(self.scene.shape, self.parameters, film, self.limits, dict(wrt), part)
            total = gradients if total is None else {name: total[name] + gradients[name] for name in total}
        return total

    def _assemble(self, kernel: Callable[[Film], Array]) -> Array:
        """The bands' pixels as one tensor."""
        width, height = self.scene.resolution
        tensor = ad.TensorXf if type(self.scene.camera.fov) is ad.Float else ad.TensorXf64
        buffer = None
        for first, rows, film in self.bands():
            pixels = kernel(film)
            if rows == height:
                buffer = pixels
            else:
                buffer = np.empty(height * width * 3, dtype=np.float32 if tensor is ad.TensorXf else np.float64) if buffer is None else buffer
                buffer[first * width * 3 : (first + rows) * width * 3] = pixels.numpy()
            if self.progress is not None:
                dr.sync_thread()
                self.progress((first + rows) / height)
        return tensor(type(self.scene.camera.fov)(buffer), (height, width, 3))


def _prepare(scene: Scene, film: Film) -> tuple[Scene, View]:
    """The scene with unit plane normals, and its camera's basis."""
    planes = tuple(replace(plane, normal=dr.normalize(plane.normal)) for plane in scene.planes)
    prepared = replace(scene, planes=planes), view(scene.camera, film.size.x / film.size.y)
    dr.eval(prepared)
    return prepared


@dr.freeze(warn_after=1 << 30)
def _image(shape: Shape, parameters: dict, film: Film, limits: Limits) -> Array:
    """A band's pixels: row-major, RGB interleaved."""
    scene, camera = _prepare(shape.filled(parameters), film)
    x, y, valid = pixel(film, dr.arange(ad.UInt32, film.lanes))

    def sample(i, j, total, active):
        total += radiance(scene, sample_ray(camera, film, x, y, i, j), limits)
        i, j = next_sample(film, i, j)
        return i, j, total, active & (j < film.side)

    zero = dr.zeros(ad.UInt32, film.lanes)
    state = zero, zero, dr.zeros(type(scene.background), film.lanes), valid
    total = dr.while_loop(state, lambda *state: state[-1], sample, mode="symbolic", label="samples")[2]
    return _develop(film, total, x, y, valid)


def _develop(film: Film, total: Array, x: Array, y: Array, valid: Array) -> Array:
    real = type(film.size.x)
    image = dr.zeros(real, film.pixels * 3)
    dr.scatter(image, total / real(film.side * film.side), y * film.width + x, valid)
    return image


@dr.freeze(warn_after=1 << 30)
def _tangent(shape: Shape, parameters: dict, film: Film, limits: Limits, wrt: dict, tangents: dict) -> Array:
    """A band's pixels, differentiated in one direction of parameter space."""
    wrt = dr.detach(wrt)
    dr.enable_grad(wrt)
    dr.set_grad(wrt, tangents)
    prepared, camera = _prepare(shape.filled(parameters | wrt), film)
    names = [name for name in wrt if not name.startswith("camera.")]
    push_forward(wrt)
    slopes = {name: dr.grad(prepared.parameters(name)[name]) for name in names}
    camera_slope, camera, scene = dr.grad(camera), dr.detach(camera), dr.detach(prepared)
    x, y, valid = pixel(film, dr.arange(ad.UInt32, film.lanes))

    def sample(i, j, total, active):
        moving = dr.detach(camera)
        dr.enable_grad(moving)
        dr.set_grad(moving, camera_slope)
        ray = sample_ray(moving, film, x, y, i, j)
        push_forward(moving)
        total += radiance_jvp(scene, slopes, dr.detach(ray), (dr.grad(ray.o), dr.grad(ray.d)), limits)[1]
        i, j = next_sample(film, i, j)
        return i, j, total, active & (j < film.side)

    zero = dr.zeros(ad.UInt32, film.lanes)
    state = zero, zero, dr.zeros(type(scene.background), film.lanes), valid
    total = dr.while_loop(state, lambda *state: state[-1], sample, mode="symbolic", label="samples")[2]
    return _develop(film, total, x, y, valid)


@dr.freeze(warn_after=1 << 30)
def _adjoint(shape: Shape, parameters: dict, film: Film, limits: Limits, wrt: dict, image: Array) -> dict:
    """Derivatives of dot(image, pixels) by the parameters, over a band."""
    wrt = dr.detach(wrt)
    dr.enable_grad(wrt)
    prepared, camera = _prepare(shape.filled(parameters | wrt), film)
    names = [name for name in wrt if not name.startswith("camera.")]
    inputs = prepared.parameters(*names) if names else {}
    if len(names) < len(wrt):
        inputs = inputs | vars(camera)
    gradients = _sums(dr.detach(prepared), dr.detach(camera), film, limits, dr.detach(inputs), image)
    for name, value in inputs.items():
        dr.set_grad(value, gradients[name])
        dr.enqueue(dr.ADMode.Backward, value)
    dr.traverse(dr.ADMode.Backward)
    return dr.grad(wrt)


def _sums(scene: Scene, camera: View, film: Film, limits: Limits, inputs: dict, image: Array) -> dict:
    """Derivatives of dot(image, pixels) by the prepared parameters."""
    real = type(film.size.x)
    lanes = min(film.lanes, REVERSE_LANES)
    lane = dr.arange(ad.UInt32, lanes)
    # Adding a zero that the compiler cannot see keeps the derivatives of each lane apart
    nothing = real(lane >> 31)
    wide = {name: value + nothing for name, value in inputs.items()}
    of_camera = {name: wide.pop(name) for name in vars(camera) if name in wide}

    def sample(index, i, j, sums, active):
        x, y, valid = pixel(film, index)
        seed = dr.gather(type(scene.background), image, y * film.width + x, valid) / real(film.side * film.side)
        basis = dr.detach(of_camera)
        dr.enable_grad(basis)
        ray = sample_ray(View(**basis) if basis else camera, film, x, y, i, j)
        still = dr.detach(ray)
        inner, o, d = radiance_vjp(scene, {n: sums[n] for n in wide}, still, limits, seed, wide)
        sums = sums | inner
        if basis:
            total = dr.dot(ray.o, o) + dr.dot(ray.d, d)
            dr.backward_from(total)
            sums = sums | {name: sums[name] + dr.grad(basis[name]) for name in basis}
        i, j = next_sample(film, i, j)
        done = j == film.side
        return dr.select(done, index + lanes, index), i, dr.select(done, 0, j), sums, active & (index < film.lanes)

    zero = dr.zeros(ad.UInt32, lanes)
    sums = {name: dr.zeros(type(value), lanes) for name, value in (wide | of_camera).items()}
    state = lane, zero, zero, sums, dr.ones(ad.Bool, lanes)
    sums = dr.while_loop(state, lambda *state: state[-1], sample, mode="symbolic", label="samples")[3]
    dr.eval(sums)
    return {name: dr.sum(value, axis=None) if dr.depth_v(value) == 1 else type(value)(*(dr.sum(x) for x in value)) for name, value in sums.items()}
