"""Planes: the points p with normal . p + offset = 0."""

import math
from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import drjit as dr

from ..core.arrays import Array
from ..core.parameter import DIRECTION, Scale, parameter
from ..core.ray import Ray, ShadowRay
from .shape import Numbers, Shape


@dataclass(frozen=True)
class Plane(Shape):
    """An infinite plane. In kernels its normal is a unit vector (`prepared`)."""

    group = "planes"
    closed, flat, casts_edges, rooted = False, True, False, True

    name: str
    material: str
    normal: Array = parameter(3, DIRECTION)
    offset: Array = parameter(1, scale=Scale(1 / 10, "view"))

    def distance(self, ray: Ray, on: Array) -> tuple[Array, Array, Array]:
        """The distance is negative behind the ray, and infinite or NaN where the two are parallel."""
        t = -self.level(ray.o) / dr.dot(self.normal, ray.d)
        return t, (t > 0) & ~on, type(on)(False)

    def reach(self, ray: Ray, on: Array, inside: Array) -> Array:
        return self.distance(ray, on)[0]

    def blocks(self, ray: ShadowRay, on: Array) -> Array:
        """The plane crosses the segment when its ends lie strictly on the two sides."""
        far = dr.dot(self.normal, ray.d) if ray.end is None else self.level(ray.end)
        return (self.level(ray.o) * far < 0) & ~on

    def level(self, p: Array) -> Array:
        """The signed distance."""
        return dr.dot(self.normal, p) + self.offset

    def implicit(self, p: Array) -> tuple[Array, Array]:
        return self.level(p), self.normal

    def outline(self, o: Array, d: Array) -> Array:
        """The horizon: lines along the plane."""
        return dr.dot(self.normal, d)

    def prepared(self) -> "Plane":
        return replace(self, normal=dr.normalize(self.normal))

    @classmethod
    def blank(cls, color: Any) -> "Plane":
        return cls("", "", type(color)(0, 1, 0), dr.value_t(color)(0))

    @staticmethod
    @lru_cache
    def place(normal: Numbers, offset: Numbers) -> Hashable:
        """Either side of a plane is the same plane."""
        length = math.hypot(*normal)
        place = (*(x / length for x in normal), *offset)
        return max(place, tuple(-x for x in place))
