"""Scenes that are ready for kernels, and for derivatives by some of their parameters.

Parameters are differentiated in two stages. The first is common to all samples: unit vectors and
the camera's frame, which depend on the parameters alone. It is differentiated once. The second
stage is the samples, which are differentiated by the outcome of the first.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import drjit as dr

from ..autodiff.forward import Direction, RaySlopes
from ..autodiff.propagate import pull_back, push_forward
from ..core.arrays import Array, Parameters
from ..core.gathered import Gathered
from ..core.packed import joined, unpacked
from ..core.ray import Ray
from ..scene.features import is_idle
from ..scene.many import SPHERES
from ..scene.scene import Scene
from ..scene.structure import Structure
from ..tracing.primary import CameraFrame, camera_frame

# Names of parameters in kernels
Names = tuple[str, ...]
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
    frame = camera_frame(scene.camera, size.y)
    dr.eval(prepared, frame)
    return prepared, frame


@dataclass(frozen=True)
class Gradients:
    """Derivatives by parameters."""

    numbers: Array | None  # by numbers and vectors, one after the other
    spheres: Array | None  # by the spheres that a tree finds

    def plus(self, other: "Gradients") -> "Gradients":
        """The sum, computed now: the kernel that adds is the same for any number of terms."""
        numbers = None if self.numbers is None else self.numbers + other.numbers
        spheres = None if self.spheres is None else self.spheres + other.spheres
        dr.eval(numbers, spheres)
        return Gradients(numbers, spheres)

    def by_name(self, structure: Structure, wrt: Names) -> Parameters:
        """The derivatives by the parameters of these names, in their order.

        Dr.Jit drops gradients that come in another order than their inputs.
        """
        found = {} if self.spheres is None else {SPHERES: self.spheres}
        if self.numbers is not None:
            found |= unpacked(structure.layout.some(wrt), self.numbers)
        dr.eval(found)
        return {name: found[name] for name in wrt}


class Forward:
    """A scene that moves in some directions of the parameters `wrt`."""

    def __init__(
        self,
        structure: Structure,
        parameters: Parameters,
        size: Array,
        wrt: Names,
        tangents: Sequence[Parameters],
    ) -> None:
        """Make the scene ready.

        Args:
            wrt: names of the parameters that move.
            tangents: of these, for each direction.
        """
        self.directions: list[Direction] = []
        self._frame_tangents = []
        for along in tangents:
            scene, frame = self._moved(structure, parameters, size, wrt, along)
            self.directions.append(scene)
            self._frame_tangents.append(dr.grad(frame))
            self.frame = dr.detach(frame)

    @staticmethod
    def _moved(
        structure: Structure,
        parameters: Parameters,
        size: Array,
        wrt: Names,
        tangents: Parameters,
    ) -> tuple[Direction, CameraFrame]:
        """The scene in one direction, and its camera's frame with a tangent."""
        of_many = tangents[SPHERES] if SPHERES in wrt else None
        moved = {name: type(parameters[name])(parameters[name]) for name in wrt if name != SPHERES}
        dr.enable_grad(moved)
        dr.set_grad(moved, {name: tangents[name] for name in moved})
        scene, frame = prepare(structure, parameters | moved, size)
        push_forward(moved)
        still = dr.detach(scene)
        if of_many is not None:
            still = still.gathering(Gathered(tangents=of_many))
        moving = {name: dr.grad(value) for name, value in _moving(scene).items()}
        return Direction(still, moving), frame

    def rays(self, ray_of: RayOf) -> tuple[Ray, RaySlopes]:
        """Rays, and their slopes in each direction."""
        slopes = []
        for tangent in self._frame_tangents:
            frame = dr.detach(self.frame)
            dr.enable_grad(frame)
            dr.set_grad(frame, tangent)
            ray = ray_of(frame)
            push_forward(frame)
            slopes.append((dr.grad(ray.o), dr.grad(ray.d)))
        return dr.detach(ray), slopes


class Reverse:
    """A scene whose derivatives by the parameters `wrt` are summed over samples."""

    def __init__(
        self,
        structure: Structure,
        parameters: Parameters,
        size: Array,
        wrt: Names,
        nothing: Array,
    ) -> None:
        """Make the scene ready.

        Args:
            wrt: names of the parameters.
            nothing: zeros as wide as the wavefront. They keep each lane's derivatives in its lane.
        """
        self.precision = structure.precision
        self.wrt = {name: type(parameters[name])(parameters[name]) for name in wrt}
        of_many = self.wrt.pop(SPHERES, None)
        dr.enable_grad(self.wrt)
        scene, frame = prepare(structure, parameters | self.wrt, size)
        moves = any(name.startswith("camera.") for name in wrt)
        self.inputs = _moving(scene) | (vars(frame) if moves else {})
        self.scene, self.frame = dr.detach(scene), dr.detach(frame)
        self.wide = {name: value + nothing for name, value in dr.detach(self.inputs).items()}
        self.frame_moves = moves
        # Derivatives by the spheres that a tree finds are not summed by lane
        self.of_many = Gathered()
        if of_many is not None:
            zeros = dr.zeros(type(of_many), dr.width(of_many))
            dr.make_opaque(zeros)
            self.of_many = Gathered(sums=zeros)
            self.scene = self.scene.gathering(self.of_many)

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

    def gradients(self, sums: Parameters) -> Gradients:
        """The derivatives by the parameters, from the sums over lanes."""
        dr.eval(sums)
        for name, value in self.inputs.items():
            dr.set_grad(value, _total(sums[name]))
            dr.enqueue(dr.ADMode.Backward, value)
        dr.traverse(dr.ADMode.Backward)
        numbers = joined(dr.grad(self.wrt), self.precision) if self.wrt else None
        return Gradients(numbers, self.of_many.sums)


def _moving(scene: Scene) -> Parameters:
    """The parameters of a prepared scene that depend on those that are differentiated.

    The camera's are left out: samples read its frame. So is what nothing depends on.
    """
    names = (
        name
        for name, where in scene.locations.items()
        if not (name.startswith(("camera.", "many.")) or is_idle(scene, where))
    )
    values = scene.parameters(*names)
    return {name: value for name, value in values.items() if dr.grad_enabled(value)}


def _total(value: Array) -> Array:
    """The sum over lanes, of each component."""
    if dr.depth_v(value) == 1:
        return dr.sum(value)
    return type(value)(*(dr.sum(part) for part in value))
