"""The pinhole camera."""

from dataclasses import dataclass

from ..core.arrays import Array
from ..core.parameter import ANGLE, Scale, parameter


@dataclass(frozen=True)
class Camera:
    """An eye, what it looks at, and its vertical field of view in degrees."""

    position: Array = parameter(3, scale=Scale(1 / 10, "view"))
    look_at: Array = parameter(3, scale=Scale(1 / 10, "view"))
    fov: Array = parameter(1, ANGLE, scale=Scale(1 / 2, "value"))
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
