"""Flat shapes: parts of a plane, without thickness. Both sides show.

A flat shape has a `normal`, a unit vector in kernels. Its `level` is the signed distance from its
plane, and `covers` tells which part of the plane it is.
"""

import math
from abc import abstractmethod
from collections.abc import Hashable, Mapping
from dataclasses import replace
from operator import mul
from typing import Any, TypeVar

import drjit as dr

from ..core.arrays import Array, Precision
from ..core.parameter import Numbers, parameters_of
from ..core.ray import NONE, Ray, ShadowRay
from .shape import Shape

Own = TypeVar("Own", bound="FlatShape")


class FlatShape(Shape):
    """A part of a plane."""

    closed, flat = False, True

    normal: Array

    @abstractmethod
    def covers(self, o: Array, d: Array, t: Array) -> Array:
        """Bool: the shape goes as far as where a line meets its plane, at the distance t."""

    def distance(self, ray: Ray, on: Array, *known: Array) -> tuple[Array, Array, Array]:
        """A shape through the eye is seen from its edge: not at all."""
        t = self.reach(ray, on, on)
        meets = (t > 0) & self.covers(ray.o, ray.d, t) & ~on
        if self.under_eye is not False:
            meets &= (ray.source != NONE) | ~(type(on)(True) & self.under_eye)
        return t, meets, type(on)(False)

    def reach(self, ray: Ray, on: Array, inside: Array) -> Array:
        """Infinite or NaN along the plane: comparisons with it are false."""
        return self._meeting(ray.o, ray.d)

    def blocks(self, ray: ShadowRay, on: Array, ends_on: Array | bool = False) -> Array:
        """The ends of the segment lie strictly on the two sides of the plane."""
        if ends_on:
            return type(on)(False)
        far = dr.dot(self.normal, ray.d) if ray.end is None else self.level(ray.end)
        crosses = self.level(self.side(ray)) * far < 0
        return crosses & self.covers(ray.o, ray.d, self._meeting(ray.o, ray.d)) & ~on

    def implicit(self, p: Array) -> tuple[Array, Array]:
        return self.level(p), self.normal

    def _meeting(self, o: Array, d: Array) -> Array:
        """The distance at which a line meets the plane."""
        return -self.level(o) * dr.rcp(dr.dot(self.normal, d))

    def prepared(self: Own) -> Own:
        unit: Any = replace(self, normal=dr.normalize(self.normal))  # type: ignore[call-arg]
        return unit

    @classmethod
    def passes_through(cls, point: Numbers, precision: Precision, *numbers: Numbers) -> bool:
        """Whether a point is in the shape's plane, as far as rounded numbers tell."""
        terms = cls.terms(point, dict(zip(parameters_of(cls), numbers, strict=True)))
        return abs(math.fsum(terms)) <= 4 * precision.epsilon * max(map(abs, terms))

    @classmethod
    def terms(cls, point: Numbers, fields: Mapping[str, Numbers]) -> list[float]:
        """The terms of a sum that is 0 in the shape's plane; here, of one that has a center."""
        normal, center = fields["normal"], fields["center"]
        return [*map(mul, normal, point), *(-n * c for n, c in zip(normal, center, strict=True))]

    @classmethod
    def place(cls, *numbers: Numbers) -> Hashable:
        """A flat shape that is turned over is the same shape."""
        fields = dict(zip(parameters_of(cls), numbers, strict=True))
        length = math.hypot(*fields["normal"])
        unit = tuple(x / length for x in fields.pop("normal"))
        return max(unit, tuple(-x for x in unit)), *fields.values()
