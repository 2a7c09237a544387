"""What keeps a light away from a surface."""

from dataclasses import dataclass, replace

import drjit as dr

from ..core.arrays import Array
from ..core.ray import ShadowRay
from ..lights.light import Toward
from ..scene.features import may, shadow
from ..scene.scene import Scene
from .surface import Surface


@dataclass(frozen=True)
class Incident:
    """A light as a surface sees it."""

    toward: Toward
    cosine: Array  # of the angle between the direction to the light and the normal
    ray: ShadowRay  # detached
    blocked: Array  # Bool: something keeps all of the light away
    # What is left behind things that keep a part of the light away, and a hash of those things
    # (UInt32); None in a scene where all shadows are full
    transmitted: Array | None
    veil: Array | None

    @property
    def dark(self) -> Array:
        """Bool: nothing of the light arrives."""
        if self.transmitted is None:
            return self.blocked
        return self.blocked | (dr.detach(self.transmitted) == 0)


def incident(scene: Scene, at: Surface, number: int, all_sides: bool = False) -> Incident:
    """Where a light of this number is as seen from a surface, and what is in between.

    Args:
        all_sides: whether what is in between matters on the side that is turned away, too.
    """
    for known in ((number, True), (number, all_sides)):
        if known in at.lights:
            return at.lights[known]
    seen = at.lights[number, all_sides] = _incident(scene, at, number, all_sides)
    return seen


def _incident(scene: Scene, at: Surface, number: int, all_sides: bool) -> Incident:
    toward = scene.lights[number].toward(at.p)
    cosine = dr.dot(at.n, toward.direction)
    ends_on = scene.features.places.under_lights[number]
    for primitive in ends_on:
        # A flat surface that the light is on, it grazes: rounding would tell which side it is on
        along = at.shape.whether(lambda kind: kind.flat) & (at.hit.index == primitive)
        cosine = dr.select(along, 0, cosine)
    wanted = at.hits if all_sides else at.hits & (dr.detach(cosine) > 0)
    ray = shadow_ray(scene, at, toward, wanted, number)
    if at.hit.shadows is not None:
        return Incident(toward, cosine, ray, (at.hit.shadows & (1 << number)) != 0, None, None)
    sets = dr.detach(scene).sets
    blocked = dr.mask_t(cosine)(False)
    full = shadowing(scene, "full")
    for primitives in sets:
        blocked |= primitives.blocked(replace(ray, wanted=ray.wanted & ~blocked), full)
    passes = {m.name: 1 - m.shadow for m in scene.used if shadow(scene, m) == "part"}
    if not passes:
        return Incident(toward, cosine, ray, blocked, None, None)

    transmitted, veil = dr.value_t(at.p)(1), type(at.hit.index)(0)
    for primitives in sets:
        transmitted, veil = primitives.transmitted(ray, passes, transmitted, veil)
    return Incident(toward, cosine, ray, blocked, transmitted, veil)


def shadowing(scene: Scene, *how: str) -> list[str]:
    """The materials that keep all of a light away ("full"), or a part of it ("part")."""
    return [material.name for material in scene.used if shadow(scene, material) in how]


def shadow_ray(scene: Scene, at: Surface, toward: Toward, wanted: Array, light: int) -> ShadowRay:
    """The segment from a surface to a light, detached."""
    p, toward, eye = dr.detach(at.p), dr.detach(toward), dr.detach(scene.camera.position)
    segment = p, toward.direction, toward.distance, toward.end
    clear = frozenset(m.name for m in scene.used if may(scene, m, "refraction"))
    ends_on = scene.features.places.under_lights[light]
    return ShadowRay(*segment, at.hit.index, at.hit.inside, wanted, light, ends_on, eye, clear)
