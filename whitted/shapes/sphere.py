"""Spheres.

A sphere's normal points out of it. Source of the stable quadratic: E. Haines, J. Guenther,
T. Akenine-Moeller, "Precision Improvements for Ray/Sphere Intersection", Ray Tracing Gems (2019),
chapter 7.
"""

import math
from dataclasses import dataclass
from fractions import Fraction

import drjit as dr

from ..core.arrays import Array, Precision
from ..core.numerics import safe_sqrt, two_sum
from ..core.parameter import POSITIVE, Numbers, Scale, parameter
from ..core.ray import NONE, Ray, ShadowRay
from .shape import Shape

# An eye closer to a sphere than this part of the radius needs compensated sums: the level there is
# a difference of squares, which loses five bits of 24 at 1/32, and 34 of 53 at 2^-34. A larger part
# makes more scenes slower.
NEAR = {"single": 1 / 32, "double": 2.0**-34}


@dataclass(frozen=True)
class Sphere(Shape):
    """A sphere."""

    group = "spheres"
    closed, flat, divides = True, False, True
    casts_edges, rooted = True, True

    name: str
    material: str
    center: Array = parameter(3, scale=Scale(1, "radius"))
    radius: Array = parameter(1, POSITIVE, scale=Scale(1, "radius"))

    def approach(self, ray: Ray, on: Array) -> tuple[Array, tuple[Array, ...]]:
        """The ray's line meets the sphere, and not only behind the ray.

        Half a chord is no longer than the radius, also when both are rounded. From a sphere with
        the eye close to it, the distance may be too inexact to tell what is behind.
        """
        b, discriminant = self._chord(ray.o, ray.d)
        near = discriminant > 0
        if not self.compensated:
            near &= b > -self.radius
        return dr.select(on, ray.inward, near), (b, discriminant)

    def distance(self, ray: Ray, on: Array, *known: Array) -> tuple[Array, Array, Array]:
        """A ray that starts on the sphere meets it again at 2 b if it goes inward, else never.

        An eye on the sphere is outside of it: its rays enter right there, or never.
        """
        b, discriminant = known or self._chord(ray.o, ray.d)
        half = dr.sqrt(discriminant)
        if self.compensated:
            # The root near the origin is the product of the roots over the far one
            product = self.level(ray.o)
            far = dr.select(b > 0, b + half, product / (b - half))
            near = dr.select(b > 0, product / (b + half), b - half)
            within = product < 0
        else:
            near, far = b - half, b + half
            within = near <= 0
        meets = discriminant > 0
        if self.under_eye is not False:
            first = (ray.source == NONE) & self.under_eye
            near, within = dr.select(first, 0, near), within & ~first
            t = dr.select(within, far, near)
            meets &= (t > 0) | (first & (b > 0))
        else:
            t = dr.select(within, far, near)
            meets &= t > 0
        return dr.select(on, dr.fmax(2 * b, 0), t), dr.select(on, ray.inward, meets), on | within

    def reach(self, ray: Ray, on: Array, inside: Array) -> Array:
        b, discriminant = self._chord(ray.o, ray.d)
        half = dr.sqrt(dr.select(discriminant > 0, discriminant, 0))
        return dr.select(on, 2 * b, dr.select(inside, b + half, b - half))

    def blocks(self, ray: ShadowRay, on: Array, ends_on: Array | bool = False) -> Array:
        """One end of the segment is in the sphere and the other is not; or both are outside, and
        the line's point nearest to the center lies between them and in the sphere.

        A light exactly on the sphere is outside of it.
        """
        b, discriminant = self._chord(ray.o, ray.d)
        starts_in = dr.select(on, ray.inward, self.level(self.side(ray)) < 0)
        outside = ray.end is None or ends_on is True
        ends_in = dr.mask_t(b)(False) if outside else self.level(ray.end) < 0
        if ends_on is not False and not outside:
            ends_in &= ~ends_on
        leaves = (starts_in ^ ends_in) & ~(on & ~ray.inward)
        between = (discriminant > 0) & (b > 0) & (b < ray.distance)
        return leaves | (~on & ~starts_in & ~ends_in & between)

    def level(self, p: Array) -> Array:
        """|p - center|^2 - radius^2: negative inside, positive outside.

        For a `compensated` sphere the sum includes the rounding errors of every step but the last.
        That keeps it exact to rounding where the plain difference of two large squares has lost
        every digit.
        """
        square = self.radius * self.radius
        if not self.compensated:
            return dr.squared_norm(p - self.center) - square
        differences = (two_sum(p[axis], -self.center[axis]) for axis in range(3))
        total, error = -square, -dr.fma(self.radius, self.radius, -square)
        for high, low in differences:
            square = high * high
            total, lost = two_sum(total, square)
            error += lost + dr.fma(high, high, -square) + 2 * high * low
        return total + error

    def implicit(self, p: Array) -> tuple[Array, Array]:
        outward = p - self.center
        return (dr.squared_norm(outward) - self.radius * self.radius) / 2, outward

    def outline(self, o: Array, d: Array) -> Array:
        """The discriminant: radius^2 less the squared distance of the center from the line.

        Of a line that starts on the sphere it is never negative. Then the cosine tells instead, by
        how much the line dips below the horizon.
        """
        b, discriminant = self._chord(o, d)
        if self.under_eye is False:
            return discriminant
        return dr.select(self.under_eye, b - safe_sqrt(self.level(o)), discriminant)

    def extent(self) -> Array:
        return self.radius

    def _chord(self, o: Array, d: Array) -> tuple[Array, Array]:
        """Distance along a line to its point nearest to the center, and the discriminant.

        The line meets the sphere if the discriminant is positive: its square root before that
        point, and as far behind it.
        """
        to_center = self.center - o
        b = dr.dot(to_center, d)
        if self.compensated:
            return b, dr.fma(b, b, -self.level(o))
        miss = dr.fma(d, -b, to_center)
        return b, dr.fma(self.radius, self.radius, -dr.squared_norm(miss))

    @classmethod
    def passes_through(cls, point: Numbers, precision: Precision, *numbers: Numbers) -> bool:
        """Exactly, for the numbers themselves, or for the decimals that they stand for."""
        center, (radius,) = numbers
        largest = max(map(abs, (*point, *center, radius)))
        if abs(math.dist(point, center) - radius) > 4 * precision.epsilon * largest:
            return False

        def written(x: float) -> Fraction:
            return Fraction(str(precision.dtype(x)))

        return any(
            sum((of(a) - of(b)) ** 2 for a, b in zip(point, center, strict=True)) == of(radius) ** 2
            for of in (Fraction, written)
        )

    @classmethod
    def needs_compensation(cls, eye: Numbers, precision: Precision, *numbers: Numbers) -> bool:
        center, (radius,) = numbers
        return abs(math.dist(eye, center) - radius) < NEAR[precision.name] * radius
