"""What a surface sends back of itself: ambient light, and each light's Lambert and Blinn-Phong terms, hard-shadowed.

Source: T. Whitted, "An Improved Illumination Model for Shaded Display", CACM 23(6), 1980; the half vector is from
J. F. Blinn, "Models of Light Reflection for Computer Synthesized Pictures", SIGGRAPH 1977.
"""

from dataclasses import dataclass

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
    for light in scene.lights:
        from_light = incident(scene, at, light)
        sent = color * from_light.cosine
        if specular is not None:
            sent += specular * blinn_phong(ray.d, at.n, from_light.direction, shininess)
        lit = at.hits & (from_light.cosine > 0) & ~from_light.blocked
        radiance += dr.select(lit, sent * received(light, from_light.squared_distance), 0)
    return dr.select(at.hits, radiance, scene.background)


@dataclass(frozen=True)
class Incident:
    """A light as a surface sees it."""

    direction: Array  # unit vector to the light
    squared_distance: Array
    cosine: Array  # of the angle between the direction and the normal
    blocked: Array  # Bool: something crosses the segment to the light


def incident(scene: Scene, at: Surface, light: PointLight) -> Incident:
    """Where a light is as seen from a surface, and whether anything is in between."""
    direction = light.position - at.p
    squared = dr.squared_norm(direction)
    squared = dr.select(squared > 0, squared, 1)
    distance = dr.sqrt(squared)
    direction /= distance
    segment = dr.detach((at.p, light, direction, distance))
    return Incident(direction, squared, dr.dot(at.n, direction), occluded(dr.detach(scene), *segment, at.hit))


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
