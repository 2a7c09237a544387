"""The nearest primitive along a ray."""

import drjit as dr

from ..core.ray import NONE, Ray
from ..scene.scene import Scene
from ..shapes.sets import Hit


def closest_hit(scene: Scene, ray: Ray) -> Hit:
    """The nearest primitive in front of the ray."""
    real, mask = dr.value_t(type(ray.o)), dr.mask_t(ray.o.x)
    hit = Hit(real(dr.inf), dr.uint32_array_t(real)(NONE), mask(False))
    for primitives in scene.sets:
        hit = primitives.closest(ray, hit)
    return hit
