"""Kernels for samples and edges at any image position, rather than for the pixels of a film.

Each has one lane for each of its inputs, whose number may differ from call to call, and runs in a frozen function.
"""

from collections.abc import Callable

import drjit as dr

from .camera import View, image_ray
from .crossing import Crossing, Segment, cross
from .derivative import Edge, level_jvp, level_vjp, pull_back, push_forward, radiance_jvp, radiance_vjp
from .frozen import frozen
from .geometry import Array, Ray
from .scene import Scene, Shape
from .trace import Limits, labelled_radiance
from .wavefront import of_scene, prepare, total

# The pixel of what is outside of the band
NOWHERE = 0xFFFFFFFF


@frozen
def samples(shape: Shape, parameters: dict, size: Array, limits: Limits, x: Array, y: Array) -> tuple[Array, Array]:
    """Radiance of samples at image positions, and their labels."""
    scene, camera = prepare(shape.filled(parameters), size)
    color, label = labelled_radiance(scene, image_ray(camera, size, x, y), limits)
    return _in_lanes(x, color), _in_lanes(x, label)


def _in_lanes(x: Array, value: Array) -> Array:
    """The value in as many lanes as x has: a constant would keep the number of the call that was recorded."""
    return dr.select(x < dr.inf, value, type(value)(77))


@frozen
def crossings(shape: Shape, parameters: dict, size: Array, limits: Limits, segment: Segment) -> Crossing:
    """Where edges cross segments between samples of different labels."""
    scene, camera = prepare(shape.filled(parameters), size)
    found = cross(scene, camera, size, segment, limits)
    for part in (found, found.edge.path, found.edge.event):
        for name, value in vars(part).items():
            if name != "edge":
                setattr(part, name, _in_lanes(segment.x, value))
    return found


RayAt = Callable[[Array, Array], tuple[Ray, Array, Array]]


@frozen
def samples_jvp(
    shape: Shape, parameters: dict, size: Array, limits: Limits, wrt: dict, tangents: dict, x: Array, y: Array
) -> Array:
    """The derivative of radiance at image positions along the tangents of the parameters `wrt`."""
    scene, slopes, ray_at = _moving(shape, parameters, size, wrt, tangents)
    return _in_lanes(x, radiance_jvp(scene, slopes, *ray_at(x, y), limits))


@frozen
def levels_jvp(
    shape: Shape, parameters: dict, size: Array, limits: Limits, wrt: dict, tangents: dict, x: Array, y: Array, edge: Edge
) -> Array:
    """The derivative of edges' level functions at image positions along the tangents of the parameters `wrt`."""
    scene, slopes, ray_at = _moving(shape, parameters, size, wrt, tangents)
    ray, o, d = ray_at(x, y)
    ((slope, *_),), _ = level_jvp(scene, slopes, ray, [(o, d)], limits, edge)
    return _in_lanes(x, slope)


def _moving(shape: Shape, parameters: dict, size: Array, wrt: dict, tangents: dict) -> tuple[Scene, dict, RayAt]:
    """The scene, its own parameters' tangents, and a function from image positions to rays and their tangents."""
    wrt = dr.detach(wrt)
    dr.enable_grad(wrt)
    dr.set_grad(wrt, tangents)
    scene, camera = prepare(shape.filled(parameters | wrt), size)
    push_forward(wrt)
    slopes = {name: dr.grad(value) for name, value in of_scene(scene, wrt).items()}
    camera_slope, camera = dr.grad(camera), dr.detach(camera)

    def ray_at(x: Array, y: Array) -> tuple[Ray, Array, Array]:
        moving = dr.detach(camera)
        dr.enable_grad(moving)
        dr.set_grad(moving, camera_slope)
        ray = image_ray(moving, size, x, y)
        push_forward(moving)
        return dr.detach(ray), dr.grad(ray.o), dr.grad(ray.d)

    return dr.detach(scene), slopes, ray_at


@frozen
def samples_vjp(
    shape: Shape,
    parameters: dict,
    size: Array,
    limits: Limits,
    wrt: dict,
    adjoint: Array,
    pixel: Array,
    weight: Array,
    x: Array,
    y: Array,
) -> dict:
    """The derivatives by the parameters `wrt` of dot(adjoint, pixels), to which image positions add weighted radiance."""
    reverse = _Reverse(shape, parameters, size, wrt, dr.width(x))
    seed = weight * _gathered(shape, adjoint, pixel)

    def walk(scene, sums, wide, ray):
        return radiance_vjp(scene, sums, wide, ray, seed, limits, moves=bool(reverse.basis))

    return reverse.gradients(x, y, walk)


@frozen
def levels_vjp(
    shape: Shape,
    parameters: dict,
    size: Array,
    limits: Limits,
    wrt: dict,
    adjoint: Array,
    pixels: Array,
    change: Array,
    jump: Array,
    x: Array,
    y: Array,
    edge: Edge,
) -> dict:
    """The derivatives by the parameters `wrt` of dot(adjoint, pixels), which edges change as their level functions grow.

    Args:
        pixels: Array2u, the two pixels that an edge changes.
        change: Array2f, by how much of the jump.
    """
    reverse = _Reverse(shape, parameters, size, wrt, dr.width(x))
    seed = sum(change[k] * dr.dot(_gathered(shape, adjoint, pixels[k]), jump) for k in range(2))

    def walk(scene, sums, wide, ray):
        return level_vjp(scene, sums, wide, ray, seed, limits, edge)

    return reverse.gradients(x, y, walk)


def _gathered(shape: Shape, adjoint: Array, pixel: Array) -> Array:
    """The adjoint of pixels, and zero for NOWHERE."""
    return dr.gather(type(shape.scene.background), adjoint, pixel, pixel != NOWHERE)


class _Reverse:
    """Derivatives by the parameters `wrt`, summed over lanes."""

    def __init__(self, shape: Shape, parameters: dict, size: Array, wrt: dict, lanes: int) -> None:
        self.wrt = dr.detach(wrt)
        dr.enable_grad(self.wrt)
        scene, camera = prepare(shape.filled(parameters | self.wrt), size)
        self.inputs = of_scene(scene, wrt) | (vars(camera) if any(name.startswith("camera.") for name in wrt) else {})
        self.scene, self.camera, self.size = dr.detach(scene), dr.detach(camera), size
        # Arrays as wide as the wavefront keep the derivatives of each lane apart
        self.wide = {name: value + dr.zeros(type(value), lanes) for name, value in dr.detach(self.inputs).items()}
        self.basis = {name: self.wide.pop(name) for name in vars(camera) if name in self.wide}

    def gradients(self, x: Array, y: Array, walk: Callable) -> dict:
        """Those at image positions: walk(scene, sums, wide, ray) -> sums, derivatives by the ray's o, and by its d."""
        moving = dr.detach(self.basis)
        dr.enable_grad(moving)
        ray = image_ray(View(**moving) if moving else self.camera, self.size, x, y)
        nothing = {name: dr.zeros(type(value), dr.width(x)) for name, value in self.wide.items()}
        sums, o, d = walk(self.scene, nothing, self.wide, dr.detach(ray))
        if moving:
            pull_back(dr.dot(ray.o, o) + dr.dot(ray.d, d), dr.ones(type(x)))
            sums = sums | {name: dr.grad(value) for name, value in moving.items()}
        dr.eval(sums)
        for name, value in self.inputs.items():
            dr.set_grad(value, total(sums[name]))
            dr.enqueue(dr.ADMode.Backward, value)
        dr.traverse(dr.ADMode.Backward)
        return dr.grad(self.wrt)
