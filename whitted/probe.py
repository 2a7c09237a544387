"""Kernels for single samples and edges at any image position, rather than for the pixels of a film.

Each has one lane for each of its inputs, whose number may differ from call to call, and runs in a frozen function.
"""

import drjit as dr

from .camera import View, image_ray
from .crossing import Crossing, Segment, locate
from .derivative import Edge, level_jvp, level_vjp, pull_back, push_forward, radiance_jvp, radiance_vjp
from .geometry import Array
from .scene import Shape
from .trace import Limits, labelled_radiance
from .wavefront import of_scene, prepare, total


@dr.freeze(state_fn=None, warn_after=1 << 30)
def samples(shape: Shape, parameters: dict, size: Array, limits: Limits, x: Array, y: Array) -> tuple[Array, Array]:
    """Radiance at image positions, and the samples' labels."""
    scene, camera = prepare(shape.filled(parameters), size)
    return labelled_radiance(scene, image_ray(camera, size, x, y), limits)


@dr.freeze(state_fn=None, warn_after=1 << 30)
def crossings(shape: Shape, parameters: dict, size: Array, limits: Limits, segment: Segment) -> Crossing:
    """Where edges cross segments between samples of different labels."""
    scene, camera = prepare(shape.filled(parameters), size)
    return locate(scene, camera, size, segment, limits)


@dr.freeze(state_fn=None, warn_after=1 << 30)
def samples_jvp(
    shape: Shape, parameters: dict, size: Array, limits: Limits, wrt: dict, tangents: dict, x: Array, y: Array
) -> Array:
    """The derivative of radiance at image positions along the tangents of the parameters `wrt`."""
    scene, ray, o, d, slopes = _moving(shape, parameters, size, wrt, tangents, x, y)
    return radiance_jvp(scene, slopes, ray, o, d, limits)


@dr.freeze(state_fn=None, warn_after=1 << 30)
def levels_jvp(
    shape: Shape, parameters: dict, size: Array, limits: Limits, wrt: dict, tangents: dict, x: Array, y: Array, edge: Edge
) -> Array:
    """The derivative of edges' level functions at image positions along the tangents of the parameters `wrt`."""
    scene, ray, o, d, slopes = _moving(shape, parameters, size, wrt, tangents, x, y)
    return level_jvp(scene, slopes, ray, o, d, limits, edge)


def _moving(shape: Shape, parameters: dict, size: Array, wrt: dict, tangents: dict, x: Array, y: Array) -> tuple:
    """The scene, rays through image positions, their tangents and those of the scene's own parameters."""
    wrt = dr.detach(wrt)
    dr.enable_grad(wrt)
    dr.set_grad(wrt, tangents)
    scene, camera = prepare(shape.filled(parameters | wrt), size)
    push_forward(wrt)
    tangents = {name: dr.grad(value) for name, value in of_scene(scene, wrt).items()}
    moving = dr.detach(camera)
    dr.enable_grad(moving)
    dr.set_grad(moving, dr.grad(camera))
    ray = image_ray(moving, size, x, y)
    push_forward(moving)
    return dr.detach(scene), dr.detach(ray), dr.grad(ray.o), dr.grad(ray.d), tangents


@dr.freeze(state_fn=None, warn_after=1 << 30)
def samples_vjp(
    shape: Shape, parameters: dict, size: Array, limits: Limits, wrt: dict, seed: Array, x: Array, y: Array
) -> dict:
    """The derivatives of the sum of dot(seed, radiance) over image positions by the parameters `wrt`."""

    def walk(scene, sums, wide, ray):
        return radiance_vjp(scene, sums, wide, ray, seed, limits)

    return _reverse(shape, parameters, size, wrt, x, y, walk)


@dr.freeze(state_fn=None, warn_after=1 << 30)
def levels_vjp(
    shape: Shape, parameters: dict, size: Array, limits: Limits, wrt: dict, seed: Array, x: Array, y: Array, edge: Edge
) -> dict:
    """The derivatives of the sum of seed * (level function) over image positions by the parameters `wrt`."""

    def walk(scene, sums, wide, ray):
        return level_vjp(scene, sums, wide, ray, seed, limits, edge)

    return _reverse(shape, parameters, size, wrt, x, y, walk)


def _reverse(shape: Shape, parameters: dict, size: Array, wrt: dict, x: Array, y: Array, walk) -> dict:
    wrt = dr.detach(wrt)
    dr.enable_grad(wrt)
    scene, camera = prepare(shape.filled(parameters | wrt), size)
    inputs = of_scene(scene, wrt) | (vars(camera) if any(name.startswith("camera.") for name in wrt) else {})
    lanes, still = dr.width(x), dr.detach(inputs)
    # Arrays as wide as the wavefront keep the derivatives of each lane apart
    wide = {name: value + dr.zeros(type(value), lanes) for name, value in still.items()}
    basis = {name: wide.pop(name) for name in vars(camera) if name in wide}
    dr.enable_grad(basis)
    ray = image_ray(View(**basis) if basis else dr.detach(camera), size, x, y)
    sums = {name: dr.zeros(type(value), lanes) for name, value in wide.items()}
    sums, o, d = walk(dr.detach(scene), sums, wide, dr.detach(ray))
    if basis:
        pull_back(dr.dot(ray.o, o) + dr.dot(ray.d, d), dr.ones(type(x), lanes))
        sums |= {name: dr.grad(value) for name, value in basis.items()}
    dr.eval(sums)
    for name, value in inputs.items():
        dr.set_grad(value, total(sums[name]))
        dr.enqueue(dr.ADMode.Backward, value)
    dr.traverse(dr.ADMode.Backward)
    return dr.grad(wrt)
