"""Rays, spheres and planes, and where they meet: the one place for sign and orientation conventions.

Conventions. Directions and normals are unit vectors; a direction points along the ray's travel; a sphere's
normal points out of it; a plane is the set n . p + offset = 0. A ray knows the primitive that it starts on
(`source`, its index in the scene, or `NONE`) and whether it leaves into that sphere (`inward`), so that its own
surface is excluded by algebra and no epsilon is needed.

Sources: the stable quadratic is from E. Haines, J. Guenther, T. Akenine-Moeller, "Precision Improvements for
Ray/Sphere Intersection", Ray Tracing Gems (2019), ch. 7; error-free sums and products are from T. J. Dekker,
"A Floating-Point Technique for Extending the Available Precision" (1971).
"""

from dataclasses import dataclass
from typing import Any

import drjit as dr

# A Dr.Jit array: its concrete type depends on the precision, and is derived from the arguments
Array = Any

NONE = 0xFFFF


@dataclass
class Ray:
    """A ray, or a wavefront of them (not frozen: Dr.Jit's loops write to their state)."""

    o: Array  # Array3f: origin
    d: Array  # Array3f: unit direction
    source: Array  # UInt32: index of the primitive it starts on, or NONE
    inward: Array  # Bool: it leaves into the sphere `source`


@dataclass(frozen=True)
class Sphere:
    name: str
    material: str
    center: Array
    radius: Array
    wide: bool = False  # so large beside the scene that single precision needs compensated sums


@dataclass(frozen=True)
class Plane:
    name: str
    material: str
    normal: Array
    offset: Array


def safe_normalize(v: Array) -> Array:
    """v / |v|, and zero, with a zero gradient, where v is zero."""
    squared = dr.squared_norm(v)
    positive = squared > 0
    return dr.select(positive, v * dr.rsqrt(dr.select(positive, squared, 1)), 0)


def two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """a + b and its rounding error, exactly."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def level(sphere: Sphere, p: Array) -> Array:
    """|p - center|^2 - radius^2: negative inside, positive outside.

    A `wide` sphere's is summed with the rounding errors of every step but the last, which keeps it exact to
    rounding where the plain difference of two large squares has lost every digit.
    """
    if not sphere.wide:
        return dr.squared_norm(p - sphere.center) - sphere.radius * sphere.radius
    high, low = zip(*(two_sum(p[i], -sphere.center[i]) for i in range(3)), strict=True)
    total, error = -sphere.radius * sphere.radius, -dr.fma(sphere.radius, sphere.radius, -sphere.radius * sphere.radius)
    for h, rest in zip(high, low, strict=True):
        square = h * h
        total, lost = two_sum(total, square)
        error += lost + dr.fma(h, h, -square) + 2 * h * rest
    return total + error


def chord(sphere: Sphere, o: Array, d: Array) -> tuple[Array, Array]:
    """Distance along the line (o, d) to the point nearest to the center, and the discriminant.

    The discriminant is radius^2 minus the squared distance of the center from the line; the line meets the sphere
    where it is positive, half a chord, its square root, before and behind the nearest point.
    """
    to_center = sphere.center - o
    b = dr.dot(to_center, d)
    if sphere.wide:
        return b, dr.fma(b, b, -level(sphere, o))
    miss = dr.fma(d, -b, to_center)
    return b, dr.fma(sphere.radius, sphere.radius, -dr.squared_norm(miss))


def sphere_distance(sphere: Sphere, ray: Ray, on: Array) -> tuple[Array, Array, Array]:
    """Where a ray meets a sphere.

    Args:
        on: Bool, the ray starts on this very sphere: then it meets it again at 2 b if it goes inward, else never.

    Returns:
        The distance t > 0, whether the ray meets the sphere at all, and whether it does so from within.
    """
    b, discriminant = chord(sphere, ray.o, ray.d)
    half = dr.sqrt(discriminant)
    if sphere.wide:
        # The root near the origin is the product of the roots over the far one
        product = level(sphere, ray.o)
        far = dr.select(b > 0, b + half, product / (b - half))
        near = dr.select(b > 0, product / (b + half), b - half)
        within = product < 0
    else:
        near, far = b - half, b + half
        within = near <= 0
    t = dr.select(on, dr.fmax(2 * b, 0), dr.select(within, far, near))
    return t, dr.select(on, ray.inward, (discriminant > 0) & (t > 0)), on | within


def plane_distance(plane: Plane, ray: Ray) -> Array:
    """Distance to a plane along the ray: negative behind it, infinite or NaN when the two are parallel."""
    return -(dr.dot(plane.normal, ray.o) + plane.offset) / dr.dot(plane.normal, ray.d)


def sphere_blocks(sphere: Sphere, p: Array, light: Array, to_light: Array, distance: Array, on: Array, inside: Array) -> Array:
    """Whether a sphere crosses the open segment from p to a light.

    It does when one end is in it and the other is not, or when both are outside and the line's nearest point lies
    between them, in the sphere. No root is taken, so that a light exactly on the sphere casts no noise.

    Args:
        p, to_light, distance: start of the segment, unit direction and length.
        on: Bool, p lies on this very sphere, and `inside` tells from which side.
    """
    b, discriminant = chord(sphere, p, to_light)
    p_in = dr.select(on, inside, level(sphere, p) < 0)
    light_in = level(sphere, light) < 0
    return (p_in ^ light_in) & ~(on & ~inside) | (~on & ~p_in & ~light_in & (discriminant > 0) & (b > 0) & (b < distance))


def plane_blocks(plane: Plane, p: Array, light: Array) -> Array:
    """Whether a plane crosses the open segment from p to a light: they lie strictly on its two sides."""
    return (dr.dot(plane.normal, p) + plane.offset) * (dr.dot(plane.normal, light) + plane.offset) < 0
