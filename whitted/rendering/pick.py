"""`pick`: what is seen at a place of the picture."""

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import ad

from ..core.arrays import Array, Parameters
from ..core.derivatives import LOCK
from ..core.frozen import frozen
from ..core.interrupts import heed
from ..core.ray import NONE
from ..sampling.differentiated import prepare
from ..scene.scene import Scene, checked_scene
from ..scene.structure import Structure
from ..tracing.intersect import closest_hit
from ..tracing.node import Limits, Node, visit
from ..tracing.primary import image_ray
from .job import Job
from .samples import checked_resolution

# A surface that passes on at least this part of its light shows something else
PASSES = 0.5


@dataclass(frozen=True)
class Pick:
    """What is seen at a place of the picture."""

    name: str  #: of the shape or the cloud, such as "spheres.ball"
    point: tuple[float, float, float]  #: where it is met
    distance: float  #: of that point from the camera, along the rays that lead there
    sphere: int | None  #: of a cloud, the number of the sphere


def pick(
    scene: Scene,
    x: float,
    y: float,
    *,
    through: bool = False,
    resolution: tuple[int, int] | None = None,
) -> Pick | None:
    """The shape that is seen at a place of the picture.

    Args:
        x, y: in pixels, x from the left in [0, width], y from the top in [0, height]. The middle of
            the first pixel is (0.5, 0.5).
        through: look into mirrors and through glass: follow the heaviest ray as long as a surface
            passes on at least half of its light.
        resolution: width and height in pixels, in place of the scene's.

    Returns:
        The shape, or None where the background is seen.

    Raises:
        TypeError: no scene is given, but its name, say.
        ValueError: a place outside of the picture, or a bad resolution.

    Example:
        >>> whitted.pick(whitted.load_scene("cornell"), 300, 420).name
        'spheres.ball'
    """
    checked_scene(scene)
    heed()
    size = checked_resolution(scene.resolution if resolution is None else resolution)
    for name, value, most in (("x", x, size[0]), ("y", y, size[1])):
        is_number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
        if not (is_number and 0 <= value <= most):
            raise ValueError(f"{name}: expected pixels from 0 to {most}, got {value!r}")
    with LOCK:
        return _picked(scene, float(x), float(y), size, through)


def indices(scene: Scene, resolution: tuple[int, int]) -> Array:
    """UInt32: the number of the shape in each pixel's middle, row by row; NONE for none.

    Numbers are those of `Scene.number_of`.
    """
    width, height = resolution
    parameters = scene.given
    with LOCK:
        return _indices(scene.structure, parameters, _size_of(scene, resolution), width * height)


def _size_of(scene: Scene, resolution: tuple[int, int]) -> Array:
    real = scene.precision.real
    return scene.precision.vector2(*(dr.opaque(real, n) for n in resolution))


def _picked(scene: Scene, x: float, y: float, size: tuple[int, int], through: bool) -> Pick | None:
    real, parameters = scene.precision.real, scene.given
    limits = Job(scene, parameters, size, scene.max_depth, 1, None).limits
    fixed = scene.structure, parameters, limits
    place = dr.opaque(real, x), dr.opaque(real, y)
    node = _first(*fixed[:2], _size_of(scene, size), *place)
    distance = 0.0
    for _ in range(scene.max_depth):
        index, t, p, children = _meet(*fixed, node)
        number, distance = int(index[0]), distance + float(t[0])
        weights = [child.weight[0] / node.weight[0] * traced[0] for traced, child in children]
        if number == NONE or not through or not weights or max(weights) < PASSES:
            break
        node = children[int(np.argmax(weights))][1]
    if number == NONE:
        return None
    point = (float(p.x[0]), float(p.y[0]), float(p.z[0]))
    name, sphere = scene.owner_of(number)
    return Pick(name, point, distance, sphere)


@frozen
def _first(structure: Structure, parameters: Parameters, size: Array, x: Array, y: Array) -> Node:
    """The node of the camera's ray through a place."""
    scene, frame = prepare(structure, parameters, size)
    return Node.first(scene, image_ray(frame, size, x, y))


@frozen
def _meet(structure: Structure, parameters: Parameters, limits: Limits, node: Node) -> Any:
    """What a node's ray meets: number, distance, point; and for each child, Bool: it is traced."""
    scene, _ = prepare(structure, parameters, structure.precision.vector2(1, 1))
    seen = visit(scene, node, limits)
    children = tuple(zip(seen.traced, seen.children, strict=True))
    return seen.at.hit.index, seen.at.hit.t, seen.at.p, children


@frozen
def _indices(structure: Structure, parameters: Parameters, size: Array, count: int) -> Array:
    scene, frame = prepare(structure, parameters, size)
    real, index = type(size.x), dr.arange(ad.UInt32, count)
    row = ad.UInt32((ad.Float(index) + 0.5) / ad.Float(size.x))
    x = real(index - row * ad.UInt32(size.x)) + 0.5
    return closest_hit(scene, image_ray(frame, size, x, real(row) + 0.5)).index
