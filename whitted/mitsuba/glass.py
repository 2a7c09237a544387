"""Glass in glass.

A point in several glass spheres is filled by the smallest of them here. In Mitsuba each surface has
two indices of refraction, that of the inside and that of the outside.
"""

from collections.abc import Sequence

import numpy as np

from .walls import Ball


def around(spheres: Sequence[Ball]) -> list[int | None]:
    """For each sphere the number of the smallest that contains it."""
    radii, apart = _numbers(spheres)
    holds = (radii[:, None] > radii) & (apart <= radii[:, None] - radii)
    sizes = np.where(holds, radii[:, None], np.inf)
    return [int(own.argmin()) if np.isfinite(own).any() else None for own in sizes.T]


def crossing(spheres: Sequence[Ball]) -> list[tuple[int, int]]:
    """The pairs of spheres whose surfaces meet."""
    radii, apart = _numbers(spheres)
    differ = abs(radii[:, None] - radii)
    meet = (differ < apart) & (apart < radii[:, None] + radii) | (differ == 0) & (apart == 0)
    return [(int(i), int(k)) for k, i in np.argwhere(np.tril(meet, -1))]


def contains(sphere: Ball, point: np.ndarray) -> bool:
    return float(np.linalg.norm(point - sphere[0])) < sphere[1]


def _numbers(spheres: Sequence[Ball]) -> tuple[np.ndarray, np.ndarray]:
    """The radii of spheres, and the distances of their centers from each other."""
    centers = np.array([center for center, _ in spheres]).reshape(-1, 3)
    radii = np.array([radius for _, radius in spheres])
    return radii, np.linalg.norm(centers[:, None] - centers, axis=2)
