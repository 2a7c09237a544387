"""Directional lights: parallel light from infinitely far away, as from the sun."""

from dataclasses import dataclass, replace

import drjit as dr

from ..core.arrays import Array
from ..core.parameter import ANY, DIRECTION, NON_NEGATIVE, Scale, parameter
from .light import Light, Toward


@dataclass(frozen=True)
class DirectionalLight(Light):
    """Light that travels along one direction, with the same irradiance everywhere."""

    name: str
    direction: Array = parameter(3, DIRECTION)
    irradiance: Array = parameter(3, ANY, usual=NON_NEGATIVE, scale=Scale(1 / 2, "value"))

    def way(self, p: Array) -> Array:
        return -self.direction

    def toward(self, p: Array) -> Toward:
        real = dr.value_t(p)
        return Toward(self.way(p), real(dr.inf), real(1), None)

    def arriving(self, toward: Toward) -> Array:
        return self.irradiance

    def prepared(self) -> "DirectionalLight":
        return replace(self, direction=dr.normalize(self.direction))
