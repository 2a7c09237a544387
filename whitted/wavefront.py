"""The three kernels: a band's pixels, their derivative in one direction, and derivatives by all parameters at once.

Each runs in a frozen function, which skips tracing the Python code when a scene of the same shape comes again.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import drjit as dr
from drjit.llvm import ad

from .camera import View, view
from .derivative import pull_back, push_forward, radiance_jvp, radiance_vjp
from .film import Film, next_sample, pixel, sample_ray
from .frozen import frozen
from .geometry import Array
from .scene import Scene, Shape
from .trace import Limits, labelled_radiance, radiance, varies

# Lanes of the reverse kernel: each takes many pixels, so that little is left to sum
REVERSE_LANES = 1 << 14


def prepare(scene: Scene, size: Array) -> tuple[Scene, View]:
    """The scene with unit plane normals, and its camera's basis."""
    planes = tuple(replace(plane, normal=dr.normalize(plane.normal)) for plane in scene.planes)
    prepared = replace(scene, planes=planes), view(scene.camera, size.x / size.y)
    dr.eval(prepared)
    return prepared


def accumulate(film: Film, of_sample: Callable[[Array, Array, Array, Array], Array], color: Any) -> Array:
    """A band's pixels, row-major with RGB interleaved: the means of their samples; those of the margin are left out.

    Args:
        of_sample: pixel column and row in the band, and place (i, j) on the pixel's grid, to the sample's Array3f.
        color: the type of Array3f.
    """
    x, y, valid = pixel(film, dr.arange(ad.Int, film.lanes))

    def sample(i, j, total, active):
        total += of_sample(x, y, i, j)
        i, j = next_sample(film, i, j)
        return i, j, total, active & (j < film.side)

    zero = dr.zeros(ad.Int, film.lanes)
    state: Any = zero, zero, dr.zeros(color, film.lanes), valid
    total = dr.while_loop(state, lambda *state: state[-1], sample, mode="symbolic", label="samples")[2]
    pixels: Array = dr.empty(dr.value_t(color), film.pixels * 3)
    inside = valid & (x >= 0) & (y >= 0) & (x < film.width) & (y < film.rows)
    dr.scatter(pixels, total * film.step * film.step, ad.UInt32(y * film.width + x), inside)
    return pixels


@frozen
def image(shape: Shape, parameters: dict, film: Film, limits: Limits) -> Array:
    """A band's pixels, row-major with RGB interleaved."""
    scene, camera = prepare(shape.filled(parameters), film.size)

    def of_sample(x, y, i, j):
        return radiance(scene, sample_ray(camera, film, x, y, i, j), limits)

    return accumulate(film, of_sample, type(scene.background))


@frozen
def labelled_image(shape: Shape, parameters: dict, film: Film, limits: Limits) -> tuple[Array, Array]:
    """A band's pixels, and the labels of its samples and of those in its margin, row by row."""
    scene, camera = prepare(shape.filled(parameters), film.size)
    labels = dr.empty(ad.UInt64 if varies(scene) else ad.UInt32, film.labels)
    row = (film.width + 2 * film.margin) * film.side

    def of_sample(x, y, i, j):
        color, label = labelled_radiance(scene, sample_ray(camera, film, x, y, i, j), limits)
        index = ad.UInt32(((y + film.margin) * film.side + j) * row + (x + film.margin) * film.side + i)
        dr.scatter(labels, label, index)
        return color

    return accumulate(film, of_sample, type(scene.background)), labels


@frozen
def image_jvp(
    shape: Shape, parameters: dict, film: Film, limits: Limits, wrt: dict, tangents: dict, weights: Array | None = None
) -> Array:
    """The derivative of `image` along the tangents of the parameters `wrt`.

    Args:
        weights: what each sample counts for, row by row of samples [default: 1].
    """
    wrt = dr.detach(wrt)
    dr.enable_grad(wrt)
    dr.set_grad(wrt, tangents)
    moving, moving_camera = prepare(shape.filled(parameters | wrt), film.size)
    push_forward(wrt)
    tangents = {name: dr.grad(value) for name, value in of_scene(moving, wrt).items()}
    camera_tangent = dr.grad(moving_camera)
    scene, camera = dr.detach(moving), dr.detach(moving_camera)

    def of_sample(x, y, i, j):
        moving = dr.detach(camera)
        dr.enable_grad(moving)
        dr.set_grad(moving, camera_tangent)
        ray = sample_ray(moving, film, x, y, i, j)
        push_forward(moving)
        slope = radiance_jvp(scene, tangents, dr.detach(ray), dr.grad(ray.o), dr.grad(ray.d), limits)
        return slope if weights is None else slope * _weight(film, weights, x, y, i, j)

    return accumulate(film, of_sample, type(scene.background))


@frozen
def image_vjp(
    shape: Shape, parameters: dict, film: Film, limits: Limits, wrt: dict, adjoint: Array, weights: Array | None = None
) -> dict:
    """The derivatives of dot(adjoint, image) by the parameters `wrt`, with weights as those of `image_jvp`."""
    wrt = dr.detach(wrt)
    dr.enable_grad(wrt)
    scene, camera = prepare(shape.filled(parameters | wrt), film.size)
    inputs = of_scene(scene, wrt) | (vars(camera) if any(name.startswith("camera.") for name in wrt) else {})
    gradients = _vjp(dr.detach(scene), dr.detach(camera), film, limits, dr.detach(inputs), adjoint, weights)
    for name, value in inputs.items():
        dr.set_grad(value, gradients[name])
        dr.enqueue(dr.ADMode.Backward, value)
    dr.traverse(dr.ADMode.Backward)
    return dr.grad(wrt)


def of_scene(scene: Scene, wrt: dict) -> dict[str, Array]:
    """The parameters that samples read from the scene, not from the camera's basis."""
    names = [name for name in wrt if not name.startswith("camera.")]
    return scene.parameters(*names) if names else {}


def _weight(film: Film, weights: Array, x: Array, y: Array, i: Array, j: Array) -> Array:
    index = ((y * film.side + j) * film.width + x) * film.side + i
    return dr.gather(type(film.step), weights, ad.UInt32(index), (x < film.width) & (y < film.rows))


def _vjp(
    scene: Scene, camera: View, film: Film, limits: Limits, inputs: dict, adjoint: Array, weights: Array | None
) -> dict[str, Array]:
    """The derivatives of dot(adjoint, image) by the prepared parameters."""
    real, color = type(film.size.x), type(scene.background)
    lanes = min(film.lanes, REVERSE_LANES)
    stride = dr.minimum(film.count, REVERSE_LANES)
    # Adding a zero that the compiler cannot see keeps the derivatives of each lane apart
    nothing = real(dr.arange(ad.Int, lanes) >> 31)
    wide = {name: value + nothing for name, value in inputs.items()}
    basis = {name: wide.pop(name) for name in vars(camera) if name in wide}

    def sample(index, i, j, sums, active):
        x, y, valid = pixel(film, index)
        seed = dr.gather(color, adjoint, ad.UInt32(y * film.width + x), valid) * (film.step * film.step)
        seed = seed if weights is None else seed * _weight(film, weights, x, y, i, j)
        moving = dr.detach(basis)
        dr.enable_grad(moving)
        ray = sample_ray(View(**moving) if moving else camera, film, x, y, i, j)
        ours = {name: sums[name] for name in wide}
        of_scene, o, d = radiance_vjp(scene, ours, wide, dr.detach(ray), seed, limits, moves=bool(moving))
        sums = sums | of_scene
        if moving:
            pull_back(dr.dot(ray.o, o) + dr.dot(ray.d, d), dr.ones(real, lanes))
            sums = sums | {name: sums[name] + dr.grad(value) for name, value in moving.items()}
        i, j = next_sample(film, i, j)
        done = j == film.side
        index = dr.select(done, index + stride, index)
        return index, i, dr.select(done, 0, j), sums, index < film.count

    zero = dr.zeros(ad.Int, lanes)
    sums = {name: dr.zeros(type(value), lanes) for name, value in inputs.items()}
    state = dr.arange(ad.Int, lanes), zero, zero, sums, dr.ones(ad.Bool, lanes)
    sums = dr.while_loop(state, lambda *state: state[-1], sample, mode="symbolic", label="samples")[3]
    dr.eval(sums)
    return {name: total(value) for name, value in sums.items()}


def total(value: Array) -> Array:
    """The sum over lanes, of each component."""
    return dr.sum(value) if dr.depth_v(value) == 1 else type(value)(*(dr.sum(component) for component in value))
