"""The rays that leave from a surface, and what each of them weighs."""

from dataclasses import dataclass, replace

import drjit as dr

from ..core.arrays import Array
from ..core.numerics import safe_sqrt
from ..core.ray import Ray
from ..scene.features import bends, may, reflects, refracts
from ..scene.scene import Scene
from .media import relative_index
from .optics import fresnel, reflect, refract, transmission
from .surface import Surface, any_of, lookup


@dataclass
class Branch:
    """A ray that leaves from a surface."""

    weight: Array
    direction: Array
    inward: Array  # Bool: it leaves into the primitive that was hit
    active: Array  # Bool: it is to be traced


def scatter(scene: Scene, ray: Ray, at: Surface) -> list[Branch]:
    """The reflected ray and then the refracted one, as far as the scene's materials send them."""
    if not reflects(scene):
        return []
    reflection = lookup(scene, at, "reflection")
    mirror = reflect(ray.d, at.n)
    if not bends(scene):
        return [_branch(scene, at, "reflection", reflection, reflection, mirror, at.hit.inside)]

    refraction = lookup(scene, at, "refraction")
    cos_theta_i = dr.fmax(-dr.dot(at.n, ray.d), 0)
    eta = relative_index(scene, at)
    squared, total = transmission(cos_theta_i, eta)
    cos_theta_t = safe_sqrt(squared)
    mirrored, passed = reflection + dr.select(total, refraction, 0), dr.select(total, 0, refraction)
    if any(material.fresnel for material in scene.used):
        dielectric = any_of(scene, at, lambda m: m.fresnel)
        reflectance = dr.select(total, 1, fresnel(cos_theta_i, cos_theta_t, eta))
        mirrored = dr.select(dielectric, reflection * reflectance, mirrored)
        passed = dr.select(dielectric, refraction * (1 - reflectance), passed)
    first = _branch(scene, at, "reflection", mirrored, reflection, mirror, at.hit.inside)
    if not refracts(scene):
        return [first]
    direction = refract(ray.d, at.n, cos_theta_i, cos_theta_t, eta)
    second = _branch(scene, at, "refraction", passed, refraction, direction, ~at.hit.inside)
    return [first, replace(second, active=second.active & ~total)]


def _branch(
    scene: Scene,
    at: Surface,
    field: str,
    weight: Array,
    coefficient: Array,
    direction: Array,
    inward: Array,
) -> Branch:
    """A child, active where its weight is not 0, or where a 0 is being differentiated.

    Args:
        field: of the material, "reflection" or "refraction"; coefficient is its value.
    """
    active = weight != 0
    if dr.grad_enabled(coefficient):
        active |= any_of(scene, at, lambda m: may(scene, m, field))
    return Branch(weight, direction, inward, active)
