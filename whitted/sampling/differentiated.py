"""Scenes that are ready for kernels, and for derivatives by some of their parameters.

Parameters are differentiated in two stages. The first is common to all samples: unit vectors and
the camera's frame, which depend on the parameters alone. It is differentiated once. The second
stage is the samples, which are differentiated by the outcome of the first.
"""

from collections.abc import Callable
from dataclasses import replace

import drjit as dr

from ..autodiff.propagate import pull_back, push_forward
from ..core.arrays import Array, Parameters
from ..core.ray import Ray
from ..scene.scene import Scene
from ..scene.structure import Structure
from ..tracing.primary import CameraFrame, camera_frame

RayOf = Callable[[CameraFrame], Ray]
# Takes a scene, sums of derivatives, parameters as wide as the wavefront, and rays. Returns the
# sums with those of the rays added, and the derivatives by the rays' origins and directions
Walk = Callable[[Scene, Parameters, Parameters, Ray], tuple[Parameters, Array, Array]]


def prepare(structure: Structure, parameters: Parameters, size: Array) -> tuple[Scene, CameraFrame]:
    """The scene with unit vectors for its directions, and its camera's frame."""
    scene = structure.filled(parameters)
    shapes = tuple(shape.prepared() for shape in scene.shapes)
    lights = tuple(light.prepared() for light in scene.lights)
    prepared = replace(scene, shapes=shapes, lights=lights)
    frame = camera_frame(scene.camera, size.x / size.y)
    dr.eval(prepared, frame)
    return prepared, frame


class Forward:
    """A scene that moves along the tangents of the parameters `wrt`."""

    def __init__(
        self,
        structure: Structure,
        parameters: Parameters,
        size: Array,
        wrt: Parameters,
        tangents: Parameters,
    ) -> None:
        wrt = dr.detach(wrt)
        dr.enable_grad(wrt)
        dr.set_grad(wrt, tangents)
        scene, frame = prepare(structure, parameters | wrt, size)
        push_forward(wrt)
        self.scene, self.frame = dr.detach(scene), dr.detach(frame)
        self.tangents = {name: dr.grad(value) for name, value in _moving(scene).items()}
        self._frame_tangent = dr.grad(frame)

    def ray(self, ray_of: RayOf) -> tuple[Ray, Array, Array]:
        """Rays, and the tangents of their origins and directions."""
        frame = dr.detach(self.frame)
        dr.enable_grad(frame)
        dr.set_grad(frame, self._frame_tangent)
        ray = ray_of(frame)
        push_forward(frame)
        return dr.detach(ray), dr.grad(ray.o), dr.grad(ray.d)


class Reverse:
    """A scene whose derivatives by the parameters `wrt` are summed over samples."""

    def __init__(
        self,
        structure: Structure,
        parameters: Parameters,
        size: Array,
        wrt: Parameters,
        nothing: Array,
    ) -> None:
        """Make the scene ready.

        Args:
            nothing: zeros as wide as the wavefront. They keep each lane's derivatives in its lane.
        """
        self.wrt = dr.detach(wrt)
        dr.enable_grad(self.wrt)
        scene, frame = prepare(structure, parameters | self.wrt, size)
        moves = any(name.startswith("camera.") for name in wrt)
        self.inputs = _moving(scene) | (vars(frame) if moves else {})
        self.scene, self.frame = dr.detach(scene), dr.detach(frame)
        self.wide = {name: value + nothing for name, value in dr.detach(self.inputs).items()}
        self.frame_moves = moves

    def zeros(self, width: int) -> Parameters:
        """Sums over no samples."""
        return {name: dr.zeros(type(value), width) for name, value in self.inputs.items()}

    def add(self, sums: Parameters, ray_of: RayOf, walk: Walk) -> Parameters:
        """The sums with the derivatives of some samples added."""
        frame = {name: self.wide[name] for name in vars(self.frame) if name in self.wide}
        wide = {name: value for name, value in self.wide.items() if name not in frame}
        moving = dr.detach(frame)
        dr.enable_grad(moving)
        ray = ray_of(CameraFrame(**moving) if moving else self.frame)
        ours = {name: sums[name] for name in wide}
        of_scene, o, d = walk(self.scene, ours, wide, dr.detach(ray))
        sums = sums | of_scene
        if moving:
            output = dr.dot(ray.o, o) + dr.dot(ray.d, d)
            pull_back(output, dr.ones(type(output), dr.width(output)))
            sums = sums | {name: sums[name] + dr.grad(value) for name, value in moving.items()}
        return sums

    def gradients(self, sums: Parameters) -> Parameters:
        """The derivatives by the parameters, from the sums over lanes."""
        dr.eval(sums)
        for name, value in self.inputs.items():
            dr.set_grad(value, _total(sums[name]))
            dr.enqueue(dr.ADMode.Backward, value)
        dr.traverse(dr.ADMode.Backward)
        return dr.grad(self.wrt)


def _moving(scene: Scene) -> Parameters:
    """The parameters of a prepared scene that depend on those that are differentiated.

    The camera's are left out: samples read its frame.
    """
    names = (name for name in scene.locations if not name.startswith("camera."))
    values = scene.parameters(*names)
    return {name: value for name, value in values.items() if dr.grad_enabled(value)}


def _total(value: Array) -> Array:
    """The sum over lanes, of each component."""
    if dr.depth_v(value) == 1:
        return dr.sum(value)
    return type(value)(*(dr.sum(part) for part in value))
