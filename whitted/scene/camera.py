"""The pinhole camera."""

from dataclasses import dataclass

import numpy as np

from ..core.arrays import Array
from ..core.parameter import ANGLE, LARGEST, Scale, parameter

Vector = tuple[float, ...] | np.ndarray
# The sine of the least angle between `up` and the view
LEAST_SINE = 1e-6


@dataclass(frozen=True)
class Camera:
    """An eye, what it looks at, and its vertical field of view in degrees."""

    position: Array = parameter(3, scale=Scale(1 / 10, "view"))
    look_at: Array = parameter(3, scale=Scale(1 / 10, "view"))
    fov: Array = parameter(1, ANGLE, scale=Scale(1 / 2, "value"))
    # In a kernel an array, so that its numbers are not compiled in; no derivative is taken by it
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)


def view_problem(position: Vector, look_at: Vector, up: Vector | None) -> tuple[str, str] | None:
    """What is wrong with a view: the field of `Camera`, and what was expected of it.

    Args:
        up: None if it is not to be checked.
    """
    eye, target = np.array(position, np.float32), np.array(look_at, np.float32)
    if np.array_equal(eye, target):
        return "look_at", "expected a point other than camera.position"
    view = direction(np.subtract(look_at, position))
    if up is not None and not direction(np.cross(view, direction(up)), LEAST_SINE).any():
        return "up", "expected a direction not parallel to the view"
    return None


def direction(v: Vector, least: float = 1 / LARGEST) -> np.ndarray:
    """The unit vector, or zero for one that is not longer than the least length."""
    length = np.linalg.norm(v)
    return np.divide(v, length) if length > least else np.zeros(3)
