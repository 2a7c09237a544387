"""Discs: the part of a plane that is closer to a center than a radius. Both sides show."""

import math
from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import drjit as dr

from ..core.arrays import Array
from ..core.parameter import DIRECTION, POSITIVE, Scale, parameter
from ..core.ray import Ray, ShadowRay
from .shape import Numbers, Shape


@dataclass(frozen=True)
class Disc(Shape):
    """A flat disc without thickness. In kernels its normal is a unit vector (`prepared`)."""

    group = "discs"
    closed, flat, casts_edges, rooted = False, True, True, False

    name: str
    material: str
    center: Array = parameter(3, scale=Scale(1, "radius"))
    normal: Array = parameter(3, DIRECTION)
    radius: Array = parameter(1, POSITIVE, scale=Scale(1, "radius"))

    def distance(self, ray: Ray, on: Array) -> tuple[Array, Array, Array]:
        t = self.reach(ray, on, on)
        return t, (t > 0) & (self._within(ray.o, ray.d, t) > 0) & ~on, type(on)(False)

    def reach(self, ray: Ray, on: Array, inside: Array) -> Array:
        """Infinite or NaN along the disc: comparisons with it are false."""
        return -self.level(ray.o) / dr.dot(self.normal, ray.d)

    def blocks(self, ray: ShadowRay, on: Array) -> Array:
        far = dr.dot(self.normal, ray.d) if ray.end is None else self.level(ray.end)
        return (self.level(ray.o) * far < 0) & (self.outline(ray.o, ray.d) > 0) & ~on

    def level(self, p: Array) -> Array:
        """The signed distance from the disc's plane."""
        return dr.dot(self.normal, p - self.center)

    def implicit(self, p: Array) -> tuple[Array, Array]:
        return self.level(p), self.normal

    def outline(self, o: Array, d: Array) -> Array:
        """The rim: radius^2 less the squared distance of the center from where the line meets the
        plane.
        """
        return self._within(o, d, -self.level(o) / dr.dot(self.normal, d))

    def _within(self, o: Array, d: Array, t: Array) -> Array:
        return dr.fma(self.radius, self.radius, -dr.squared_norm(dr.fma(d, t, o - self.center)))

    def prepared(self) -> "Disc":
        return replace(self, normal=dr.normalize(self.normal))

    @classmethod
    def blank(cls, color: Any) -> "Disc":
        return cls("", "", type(color)(0), type(color)(0, 1, 0), dr.value_t(color)(1))

    @staticmethod
    @lru_cache
    def place(center: Numbers, normal: Numbers, radius: Numbers) -> Hashable:
        """Either side of a disc is the same disc."""
        length = math.hypot(*normal)
        unit = tuple(x / length for x in normal)
        return center, radius, max(unit, tuple(-x for x in unit))
