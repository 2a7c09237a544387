"""Shapes: spheres, discs, and rectangles that stand for planes."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .node import CLOSE, Node
from .surfaces import DEFAULT, Surface, on_wall, surface
from .walls import Ball, Wall


@dataclass(frozen=True)
class Placed:
    """A shape of Mitsuba's: its table here, what it is made of, and where it is."""

    group: str
    path: str
    table: dict[str, Any]
    surface: Surface
    # Of a flat shape
    wall: Wall | None = None

    @property
    def ball(self) -> Ball:
        """A sphere that contains it, unless it is a plane."""
        return np.array(self.table["center"]), self.table["radius"]

    def along(self, direction: np.ndarray) -> Ball:
        """Its center, and how far it reaches along a unit vector."""
        center, radius = self.ball
        sine = np.linalg.norm(np.cross(self.wall.normal, direction)) if self.wall else 1.0
        return center, radius * float(sine)


def shape(node: Node, name: str) -> Placed | None:
    """What a shape is here; None for what has no counterpart."""
    if not node.taken():
        return None
    made_of = _surface(node)
    flipped = node.flag("flip_normals")
    node.ignore("silhouette_sampling_weight", "sampling_weight")
    place = {"sphere": _sphere, "rectangle": _rectangle, "disk": _disk}[node.type]
    group, numbers, wall = place(node, flipped)
    node.finish()
    made_of = on_wall(made_of, wall if node.type == "rectangle" else None)
    return Placed(group, node.path, {"name": name, **numbers}, made_of, wall)


def _surface(node: Node) -> Surface:
    bsdf = node.child("bsdf")
    if bsdf is None:
        return DEFAULT
    # One within a shape has the shape's name, unless it has an id of its own
    own = "id" in bsdf.table or not bsdf.path.startswith(f"{node.path}.")
    return surface(bsdf, bsdf.name if own else node.name)


def _sphere(node: Node, flipped: bool) -> tuple[str, dict[str, Any], None]:
    matrix = node.matrix("to_world")
    turn = matrix[:3, :3]
    square = turn.T @ turn
    scale = float(np.sqrt(np.trace(square) / 3))
    if not scale or not np.allclose(square, scale**2 * np.eye(3), atol=10 * CLOSE * scale**2):
        node.expect("to_world", "the same scale along all axes, and no shear")
    if flipped:
        node.report.refuse(node.told("flip_normals"), "has no counterpart; expected False")
    center = turn @ node.vector("center", (0, 0, 0)) + matrix[:3, 3]
    radius = node.number("radius", 1, 0, open_=True) * scale
    return "spheres", {"center": center.tolist(), "radius": radius}, None


def _rectangle(node: Node, flipped: bool) -> tuple[str, dict[str, Any], Wall]:
    wall = _wall(node, flipped)
    numbers = {"normal": wall.normal.tolist(), "offset": wall.offset}
    return "planes", numbers, wall


def _disk(node: Node, flipped: bool) -> tuple[str, dict[str, Any], Wall]:
    wall = _wall(node, flipped)
    radii = np.linalg.norm([wall.u, wall.v], axis=1)
    if abs(radii[0] - radii[1]) > 10 * CLOSE * radii.max():
        node.expect("to_world", "the same scale along both axes of a disk")
    numbers = {
        "center": wall.center.tolist(),
        "normal": wall.normal.tolist(),
        "radius": float(radii[0]),
    }
    return "discs", numbers, wall


def _wall(node: Node, flipped: bool) -> Wall:
    matrix = node.matrix("to_world")
    u, v, center = matrix[:3, 0], matrix[:3, 1], matrix[:3, 3]
    across, area = np.cross(u, v), np.linalg.norm(u) * np.linalg.norm(v)
    volume = np.linalg.det(matrix[:3, :3])
    if volume == 0 or abs(u @ v) > 10 * CLOSE * area:
        node.expect("to_world", "a transform that can be inverted, without shear")
        return Wall(np.zeros(3), *np.eye(3))
    sign = np.sign(volume) * (-1 if flipped else 1)
    # Without the sign of a zero
    return Wall(center, u, v, sign * across / np.linalg.norm(across) + 0.0)
