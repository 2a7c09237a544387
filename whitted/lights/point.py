"""Point lights."""

from dataclasses import dataclass
from typing import Literal

import drjit as dr

from ..core.arrays import Array
from ..core.parameter import ANY, NON_NEGATIVE, Scale, parameter, setting
from .light import Light, Toward


@dataclass(frozen=True)
class PointLight(Light):
    """A light at a point.

    Its intensity is radiant intensity, in W/sr a channel; with the falloff "none" it is the
    irradiance at any distance.
    """

    name: str
    position: Array = parameter(3, scale=Scale(1 / 4, "view"))
    intensity: Array = parameter(3, ANY, usual=NON_NEGATIVE, scale=Scale(1 / 2, "value"))
    falloff: str = setting(Literal["none", "inverse-square"], "none")

    def way(self, p: Array) -> Array:
        return self.position - p

    def toward(self, p: Array) -> Toward:
        """At the light itself the distance counts as 1, so that nothing is divided by zero."""
        offset = self.way(p)
        squared = dr.squared_norm(offset)
        squared = dr.select(squared > 0, squared, 1)
        distance = dr.sqrt(squared)
        return Toward(offset / distance, distance, squared, self.position)

    def arriving(self, toward: Toward) -> Array:
        if self.falloff == "none":
            return self.intensity
        return self.intensity / toward.squared_distance
