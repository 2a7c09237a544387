"""Rectangles and infinite planes: where one can stand for the other.

Rectangles that close a room look like their planes, if the eye and all point lights are in it: no
ray leaves it, and so none reaches the rest of the planes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

# What counts as infinitely far on a plane, as a multiple of the size of the scene
FAR = 1000.0
# What is no gap between two walls, as a part of their size
GAP = 1e-4
# A point, and how far what is there reaches
Ball = tuple[np.ndarray, float]


@dataclass(frozen=True)
class Wall:
    """A rectangle or a disk: its center, the vectors from there to its sides, its unit normal."""

    center: np.ndarray
    u: np.ndarray
    v: np.ndarray
    normal: np.ndarray

    @property
    def offset(self) -> float:
        return 0.0 - float(self.normal @ self.center)

    def behind(self, balls: Sequence[Ball]) -> bool:
        """Whether something is, in a part, on the side that the normal does not point to."""
        slack = GAP * np.linalg.norm(self.u)
        return any(self.normal @ point + self.offset < reach - slack for point, reach in balls)


def upright(normal: np.ndarray, offset: float, near: np.ndarray, half: float = 1.0) -> Wall:
    """A square of some half side in a plane, around the point of it that is nearest to another.

    The sides of a wall that is square to an axis are along the other two.
    """
    axis = np.eye(3)[(int(np.argmax(abs(normal))) + 1) % 3]
    u = axis - (axis @ normal) * normal
    u *= half / np.linalg.norm(u)
    return Wall(near - (normal @ near + offset) * normal, u, np.cross(normal, u), normal)


def facing(wall: Wall, point: np.ndarray) -> Wall:
    """The wall with its normal towards a point."""
    away = wall.normal @ point + wall.offset < 0
    return Wall(wall.center, wall.u, wall.v, -wall.normal) if away else wall


def closed_room(walls: Sequence[Wall], points: Sequence[np.ndarray]) -> bool:
    """Whether walls close a room with all the points in it, the first of which is the eye."""
    inward = [facing(wall, points[0]) for wall in walls]
    if any(wall.behind([(point, 0.0) for point in points]) for wall in inward):
        return False
    return all(abs(face(wall, inward)).max(initial=0) <= 1 + GAP for wall in inward)


def face(wall: Wall, walls: Sequence[Wall]) -> np.ndarray:
    """The part of a wall's plane before all the other walls: corners, in units of u and v.

    It is cut off at a great distance. Source: I. Sutherland, G. Hodgman, "Reentrant Polygon
    Clipping", CACM 17 (1974).
    """
    corners = FAR * FAR * np.array([[-1.0, -1.0], [1, -1], [1, 1], [-1, 1]])
    for other in walls:
        if other is wall:
            continue
        slope = np.array([other.normal @ wall.u, other.normal @ wall.v])
        level = corners @ slope + other.normal @ wall.center + other.offset
        kept = []
        for k, (corner, here) in enumerate(zip(corners, level, strict=True)):
            before, there = corners[k - 1], level[k - 1]
            if (here >= 0) != (there >= 0):
                kept.append(before + (corner - before) * there / (there - here))
            if here >= 0:
                kept.append(corner)
        corners = np.array(kept).reshape(-1, 2)
        if not len(corners):
            break
    return corners


def room_of(planes: Sequence[tuple[np.ndarray, float]], points: Sequence[np.ndarray]) -> list[Wall]:
    """The rectangles that look like planes; none where the planes close no room with all the points
    in it, the first of which is the eye.

    They overlap a little, so that no ray gets out between two of them.
    """
    eye = points[0]
    walls = [upright(normal, offset, eye) for normal, offset in planes]
    inward = [facing(wall, eye) for wall in walls]
    found = []
    for wall in inward:
        corners = face(wall, inward)
        low, high = corners.min(0, initial=np.inf), corners.max(0, initial=-np.inf)
        if not (high > low).all() or max(abs(low).max(), abs(high).max()) >= FAR * FAR:
            return []
        middle, half = (low + high) / 2, (1 + GAP) * (high - low) / 2
        center = wall.center + middle[0] * wall.u + middle[1] * wall.v
        found.append(Wall(center, half[0] * wall.u, half[1] * wall.v, wall.normal))
    if any(wall.behind([(point, 0.0) for point in points]) for wall in found):
        return []
    return [
        Wall(wall.center, wall.u, wall.v, own.normal)
        for wall, own in zip(found, walls, strict=True)
    ]


def cells(wall: Wall, to_uv: np.ndarray) -> tuple[float, bool] | None:
    """The checkerboard here that looks like Mitsuba's on a rectangle.

    Args:
        to_uv: Mitsuba's transform of texture coordinates, 3 x 3.

    Returns:
        The size of a cell, and whether the two colours change places; None where Mitsuba's cells
        are not squares along the world's axes from the origin on.
    """
    drop = int(np.argmax(abs(wall.normal)))
    kept = [axis for axis in range(3) if axis != drop]

    def column_and_row(a: float, b: float) -> np.ndarray:
        """The coordinates in cells of the point of the plane with these world coordinates."""
        p = np.zeros(3)
        p[kept] = a, b
        p[drop] = -(wall.normal @ p + wall.offset) / wall.normal[drop]
        local = [side @ (p - wall.center) / (side @ side) for side in (wall.u, wall.v)]
        return 2 * (to_uv @ [(local[0] + 1) / 2, (local[1] + 1) / 2, 1])[:2]

    start = column_and_row(0, 0)
    turn = np.array([column_and_row(1, 0) - start, column_and_row(0, 1) - start])
    rate = abs(turn).max()
    steps = turn / rate if rate else turn
    along_axes = np.allclose(steps, steps.round(), atol=GAP) and np.allclose(
        steps @ steps.T, np.eye(2), atol=GAP
    )
    if not along_axes or abs(start - start.round()).max() > GAP:
        return None
    # Along an axis that is turned round, the cell before the first one is the first
    odd = start.round().sum() + (steps < -GAP).sum()
    # The last digits are rounding errors
    return float(f"{1 / rate:.14g}"), odd % 2 == 1


def to_uv(wall: Wall, size: float) -> np.ndarray:
    """The transform of texture coordinates, 4 x 4, with which Mitsuba's cells on an upright wall
    are those here.
    """
    transform = np.eye(4)
    for row, side in enumerate((wall.u, wall.v)):
        axis = int(np.argmax(abs(side)))
        # A coordinate w is center + side (2 uv - 1); its cell is w / size, half of which is taken
        transform[row, row] = side[axis] / size
        transform[row, 3] = (wall.center[axis] - side[axis]) / (2 * size)
    return transform
