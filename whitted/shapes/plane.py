"""Planes: the points p with normal . p + offset = 0."""

import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from operator import mul

import drjit as dr

from ..core.arrays import Array
from ..core.parameter import DIRECTION, Numbers, Scale, parameter
from .flat import FlatShape


@dataclass(frozen=True)
class Plane(FlatShape):
    """An infinite plane."""

    group = "planes"
    # Where the shadow of a plane ends, the plane itself meets the surface
    casts_edges = False
    divides = True
    # At the horizon, where the plane runs off into the distance
    rooted = True

    name: str
    material: str
    normal: Array = parameter(3, DIRECTION)
    offset: Array = parameter(1, scale=Scale(1 / 10, "view"))

    def level(self, p: Array) -> Array:
        return dr.dot(self.normal, p) + self.offset

    def covers(self, o: Array, d: Array, t: Array) -> Array:
        return dr.mask_t(t)(True)

    def outline(self, o: Array, d: Array) -> Array:
        """The horizon: lines along the plane."""
        return dr.dot(self.normal, d)

    @classmethod
    def terms(cls, point: Numbers, fields: Mapping[str, Numbers]) -> list[float]:
        return [*map(mul, fields["normal"], point), *fields["offset"]]

    @classmethod
    def place(cls, *numbers: Numbers) -> Hashable:
        """A plane that is turned over has the opposite offset, too."""
        normal, offset = numbers
        length = math.hypot(*normal)
        place = (*(x / length for x in normal), *offset)
        return max(place, tuple(-x for x in place))
