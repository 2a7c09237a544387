"""Clouds: many spheres of one material."""

from dataclasses import dataclass

from ..core.arrays import Array
from ..core.parameter import POSITIVE, Scale, parameter


@dataclass(frozen=True)
class Cloud:
    """Spheres whose centers and radii are arrays; a tree finds those that a ray meets."""

    group = "clouds"
    flat = False

    name: str
    material: str
    center: Array = parameter(3, scale=Scale(1, "radius"), many=True)
    radius: Array = parameter(1, POSITIVE, scale=Scale(1, "radius"), many=True)
    # The file that the numbers were read from, as the scene file names it; empty without one
    file: str = ""
