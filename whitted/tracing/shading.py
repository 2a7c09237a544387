"""The light of a surface itself: ambient light, and each light's Lambert and Blinn-Phong terms.

Sources: T. Whitted, "An Improved Illumination Model for Shaded Display", CACM 23(6), 1980; for the
half vector, J. F. Blinn, "Models of Light Reflection for Computer Synthesized Pictures", SIGGRAPH
1977.
"""

import drjit as dr

from ..core.arrays import Array
from ..core.power import power
from ..core.ray import Ray
from ..lights.light import Toward
from ..scene.features import glossy, may
from ..scene.scene import Scene
from .shadow import incident
from .surface import Surface, albedo, lookup


def emitted(scene: Scene, ray: Ray, at: Surface) -> Array:
    """Radiance along a ray, before reflection and refraction; the background if it hits nothing."""
    color = albedo(scene, at)
    radiance = scene.ambient * color if "ambient" in scene.features.live else type(at.p)(0)
    gloss = highlight(scene, at) if glossy(scene) else None
    for k, light in enumerate(scene.lights):
        seen = incident(scene, at, k)
        sent = color * seen.cosine
        if gloss is not None:
            specular, shininess = gloss
            sent += specular * blinn_phong(ray.d, at.n, seen.toward, seen.cosine, shininess)
        arriving = light.arriving(seen.toward)
        if seen.transmitted is not None:
            arriving = arriving * seen.transmitted
        lit = at.hits & (seen.cosine > 0) & ~seen.blocked
        radiance += dr.select(lit, sent * arriving, 0)
    return dr.select(at.hits, radiance, scene.background)


def highlight(scene: Scene, at: Surface) -> tuple[Array, Array]:
    """The Blinn-Phong coefficient and exponent of a surface."""
    shininess = lookup(scene, at, "shininess", lambda m: may(scene, m, "specular"))
    return lookup(scene, at, "specular"), shininess


def blinn_phong(d: Array, n: Array, toward: Toward, cosine: Array, shininess: Array) -> Array:
    """max(0, n . h)^shininess, h the direction halfway between the light and the viewer.

    n . h is the sum of two cosines, which are known, over the length of the sum of directions.
    """
    squared = dr.squared_norm(toward.direction - d)
    over_length = dr.rsqrt(dr.select(squared > 0, squared, 1))
    return power((cosine - dr.dot(n, d)) * over_length, shininess)
