"""Discs: the points of a plane that are closer to a center than a radius."""

from dataclasses import dataclass

import drjit as dr

from ..core.arrays import Array
from ..core.parameter import DIRECTION, POSITIVE, Scale, parameter
from .flat import FlatShape


@dataclass(frozen=True)
class Disc(FlatShape):
    """A flat disc."""

    group = "discs"
    casts_edges = True
    # The rim is where the disc is cut off, not where it turns away
    rooted = False

    name: str
    material: str
    center: Array = parameter(3, scale=Scale(1, "radius"))
    normal: Array = parameter(3, DIRECTION)
    radius: Array = parameter(1, POSITIVE, scale=Scale(1, "radius"))

    def level(self, p: Array) -> Array:
        return dr.dot(self.normal, p - self.center)

    def covers(self, o: Array, d: Array, t: Array) -> Array:
        return self._from_rim(o, d, t) > 0

    def outline(self, o: Array, d: Array) -> Array:
        return self._from_rim(o, d, self._meeting(o, d))

    def _from_rim(self, o: Array, d: Array, t: Array) -> Array:
        """radius^2 less the squared distance of a point of the plane from the center."""
        from_center = dr.fma(d, t, o - self.center)
        return dr.fma(self.radius, self.radius, -dr.squared_norm(from_center))
