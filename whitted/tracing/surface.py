"""What a ray meets: the point, the normal and the material."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import drjit as dr

from ..core.arrays import Array, any_true
from ..core.ray import NONE, Ray
from ..scene.features import may
from ..scene.material import Material
from ..scene.scene import Scene
from ..scene.texture import Checkerboard
from ..shapes.sets import Hit, Picked, pick


@dataclass(frozen=True)
class Surface:
    """Where a ray meets the scene."""

    p: Array  # the point that the ray reaches
    n: Array  # the unit normal there, turned towards the side that the ray came from
    hit: Hit
    hits: Array  # Bool: there is a surface
    shape: Picked  # the primitive that it is the surface of
    of: dict[str, Array]  # material name to Bool: the surface is of this material
    # What `shadow.incident` has found, so that it looks for it once
    lights: dict[Any, Any] = field(default_factory=dict)
    # The same of `media.relative_index`
    etas: list[Array] = field(default_factory=list)


def surface(scene: Scene, ray: Ray, hit: Hit) -> Surface:
    """The surface at a hit.

    It is differentiable in the scene and the ray, although the hit itself is detached. The distance
    t is the root of a level function, F(o + t d) = 0, so that dt = -dF / (grad F . d) (the implicit
    function theorem). One primitive's parameters enter, however many the search looked at.
    """
    hits = hit.index != NONE
    shape = pick(scene.sets, hit.index, scene.background)
    p = dr.fma(ray.d, dr.select(hits, hit.t, 1), ray.o)
    if dr.grad_enabled(ray, scene):
        p = _attach_distance(shape, ray, hits, p)
    outward = dr.select(hits, shape.of(lambda shape: shape.implicit(p)[1]), -dr.detach(ray.d))
    faces_away = dr.dot(dr.detach(outward), dr.detach(ray.d)) > 0
    flip = dr.select(shape.whether(lambda kind: kind.closed), hit.inside, faces_away)
    n = dr.mulsign(dr.normalize(outward), dr.select(flip, -dr.ones(dr.value_t(p)), 1))
    return Surface(p, n, hit, hits, shape, materials_of(scene, hit.index))


def _attach_distance(shape: Picked, ray: Ray, hits: Array, p: Array) -> Array:
    """The point p, moved along the ray by a Newton step of length 0 that carries dt."""
    level, gradient = shape.of(lambda shape: shape.implicit(p))
    slope = dr.dot(dr.detach(gradient), dr.detach(ray.d))
    step = (dr.detach(level) - level) / dr.select(slope == 0, 1, slope)
    return p + dr.select(hits, step, 0) * dr.detach(ray.d)


def materials_of(scene: Scene, index: Array) -> dict[str, Array]:
    """Material to Bool: the primitive of this number is made of it."""
    of: dict[str, Array] = {}
    for primitives in scene.sets:
        for name, here in primitives.materials(index).items():
            of[name] = of[name] | here if name in of else here
    return of


def any_of(scene: Scene, at: Surface, wanted: Callable[[Material], bool]) -> Array:
    """Bool: the surface is of one of the wanted materials."""
    return any_true((at.of[m.name] for m in scene.used if wanted(m)), at.hits)


def lookup(
    scene: Scene, at: Surface, field: str, wanted: Callable[[Material], bool] | None = None
) -> Array:
    """A field of the surface's material, and 0 where it is not of one of the wanted materials.

    Args:
        wanted: by default the materials whose field can differ from its neutral value.
    """
    value = type(at.p)(0) if field == "color" else dr.value_t(at.p)(0)
    for material in scene.used:
        if wanted(material) if wanted else may(scene, material, field):
            value = dr.select(at.of[material.name], getattr(material, field), value)
    return value


def albedo(scene: Scene, at: Surface) -> Array:
    """The surface's Lambertian albedo, with its checkerboard."""
    color = lookup(scene, at, "color")
    p, n = dr.detach(at.p), dr.detach(at.n)
    for material, board in boards(scene).items():
        odd = dr.detach(board).odd(p, n)
        color = dr.select(at.of[material] & odd, board.color, color)
    return color


def boards(scene: Scene) -> dict[str, Checkerboard]:
    """The checkerboards, by material."""
    return {material.name: material.checker for material in scene.used if material.checker}
