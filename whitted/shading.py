"""What a surface sends back of itself: ambient light, and each light's Lambert and Blinn-Phong terms, hard-shadowed.

Source: T. Whitted, "An Improved Illumination Model for Shaded Display", CACM 23(6), 1980; the half vector is from
J. F. Blinn, "Models of Light Reflection for Computer Synthesized Pictures", SIGGRAPH 1977.
"""

import drjit as dr

from .geometry import Array, Ray, safe_normalize
from .scene import PointLight, Scene, occluded
from .surface import Surface, albedo, lookup


def emitted(scene: Scene, ray: Ray, at: Surface) -> Array:
    """Radiance along the ray without its reflected and refracted children; the background where it hits nothing."""
    color = albedo(scene, at)
    radiance = scene.ambient * color if "ambient" in scene.nonzero else type(at.p)(0)
    specular = shininess = None
    if any(scene.may(material, "specular") for material in scene.used):
        specular = lookup(scene, at, "specular", lambda m: scene.may(m, "specular"))
        shininess = lookup(scene, at, "shininess", lambda m: scene.may(m, "specular"))
    still = dr.detach(scene)
    for light, dark in zip(scene.lights, still.lights, strict=True):
        to_light = light.position - at.p
        squared = dr.squared_norm(to_light)
        squared = dr.select(squared > 0, squared, 1)
        distance = dr.sqrt(squared)
        to_light /= distance
        cos_light = dr.dot(at.n, to_light)
        lit = at.hits & (cos_light > 0)
        lit &= ~occluded(still, dr.detach(at.p), dark, dr.detach(to_light), dr.detach(distance), at.hit)
        sent = color * cos_light
        if specular is not None:
            sent += specular * blinn_phong(ray.d, at.n, to_light, shininess)
        radiance += dr.select(lit, sent * received(light, squared), 0)
    return dr.select(at.hits, radiance, scene.background)


def received(light: PointLight, squared_distance: Array) -> Array:
    """What arrives of a light that nothing blocks."""
    return light.intensity / squared_distance if light.inverse_square else light.intensity


def blinn_phong(d: Array, n: Array, to_light: Array, shininess: Array) -> Array:
    """max(0, n . h)^shininess, h the direction halfway between the light and the viewer."""
    cos_half = dr.dot(n, safe_normalize(to_light - d))
    positive = cos_half > 0
    # Dr.Jit's exp2 is infinite at the lower end of double precision's range
    exponent = dr.fmax(shininess * dr.log2(dr.select(positive, cos_half, 1)), -1000)
    return dr.select(positive, dr.exp2(exponent), 0)
