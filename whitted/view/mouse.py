"""What a mouse does to a scene: things move with it, the camera turns, walks and comes nearer."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.parameter import Numbers
from ..scene.camera import direction
from ..scene.scene import Scene

Values = dict[str, Any]
# The field that places a thing, by its group
PLACES = {"spheres": "center", "discs": "center", "lights": "position", "planes": "offset"}
# A step of the wheel: factors of a radius and of the camera's distance
GROW, NEARER = 1.05, 0.93
# Radians that the camera turns when the mouse crosses the picture's height
TURN = np.pi
# The least angle between the view and the direction up, in radians
UPRIGHT = 0.02


@dataclass(frozen=True)
class View:
    """The camera as the mouse sees it; directions are unit vectors."""

    eye: np.ndarray
    target: np.ndarray
    forward: np.ndarray
    right: np.ndarray
    up: np.ndarray
    height: float  # of what is seen at distance 1
    aspect: float  # width / height


@dataclass(frozen=True)
class Grabbed:
    """What the mouse holds, as it was when it was taken."""

    scene: Scene
    x: float
    y: float
    name: str | None  # of a thing; None for the camera
    depth: float  # of the point that was taken, along the view
    # How it was moved last, and where the mouse was then
    how: str | None = None
    last: tuple[float, float] = (0.0, 0.0)


def view_of(scene: Scene, aspect: float) -> View:
    """The view of a scene's camera. `aspect` is width / height of the picture."""
    numbers = scene.numbers
    eye, target = (np.array(numbers[f"camera.{key}"]) for key in ("position", "look_at"))
    forward = direction(target - eye)
    right = direction(np.cross(forward, direction(scene.camera.up)))
    height = 2 * float(np.tan(np.radians(numbers["camera.fov"][0]) / 2))
    return View(eye, target, forward, right, np.cross(right, forward), height, aspect)


def place_of(numbers: Mapping[str, Numbers], name: str) -> Numbers | None:
    """Where a sphere, a disc or a point light is; None for what fills space."""
    value = numbers.get(f"{name}.{PLACES.get(name.partition('.')[0], '')}")
    return value if value is not None and len(value) == 3 else None


def projected(view: View, point: Numbers) -> tuple[float, float, float]:
    """Where a point is seen: parts of the picture's width and height; and its depth."""
    along = np.array(point) - view.eye
    depth = float(along @ view.forward)
    if depth <= 0:
        return 0.0, 0.0, depth
    half = view.height * depth
    x = 0.5 + float(along @ view.right) / (half * view.aspect)
    return x, 0.5 - float(along @ view.up) / half, depth


def dragged(held: Grabbed, x: float, y: float, how: str, aspect: float) -> Values:
    """The parameters that change when the mouse has moved.

    Args:
        x, y: where it is now, in parts of the picture.
        how: "across", in the plane parallel to the picture, or "along" the view, up is away. The
            camera turns around what it looks at, unless this is "pan".

    Returns:
        Names and numbers; empty for a thing that has no place.
    """
    view, dx, dy = view_of(held.scene, aspect), x - held.x, y - held.y
    if held.name is None:
        if how == "pan":
            return _panned(view, dx, dy)
        return _turned(view, held.scene.camera.up, dx, dy)
    scale = view.height * held.depth
    shift = scale * (dx * aspect * view.right - dy * view.up)
    return _moved(held, -scale * dy * view.forward if how == "along" else shift)


def _moved(held: Grabbed, shift: np.ndarray) -> Values:
    """A thing that is shifted. A plane's offset changes by what goes along its normal."""
    numbers, name = held.scene.numbers, held.name or ""
    place = place_of(numbers, name)
    group = name.partition(".")[0]
    if place is not None:
        return {f"{name}.{PLACES[group]}": (np.array(place) + shift).tolist()}
    if group != "planes":
        return {}
    normal = direction(numbers[f"{name}.normal"])
    return {f"{name}.offset": [numbers[f"{name}.offset"][0] - float(normal @ shift)]}


def _turned(view: View, up: tuple[float, ...], dx: float, dy: float) -> Values:
    """The camera after a turn around what it looks at; it stays off the direction up."""
    axis = direction(up)
    arm = _rotated(view.eye - view.target, axis, -dx * TURN * view.aspect)
    away = float(np.arccos(np.clip(direction(arm) @ axis, -1, 1)))
    pitch = float(np.clip(away - dy * TURN, UPRIGHT, np.pi - UPRIGHT)) - away
    side = direction(np.cross(axis, arm))
    return {"camera.position": (view.target + _rotated(arm, side, pitch)).tolist()}


def _rotated(v: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """A vector turned around a unit axis (O. Rodrigues)."""
    cos, sin = np.cos(angle), np.sin(angle)
    turned: np.ndarray = v * cos + np.cross(axis, v) * sin + axis * (axis @ v) * (1 - cos)
    return turned


def _panned(view: View, dx: float, dy: float) -> Values:
    """The camera after a walk in its own plane: what it looks at stays under the mouse."""
    scale = view.height * float(np.linalg.norm(view.target - view.eye))
    shift = scale * (dy * view.up - dx * view.aspect * view.right)
    both = {"camera.position": view.eye, "camera.look_at": view.target}
    return {name: (point + shift).tolist() for name, point in both.items()}


def wheeled(scene: Scene, name: str | None, steps: float) -> Values:
    """A radius that grows with the steps of a wheel; without one, the camera comes nearer."""
    numbers, radius = scene.numbers, f"{name}.radius"
    if len(numbers.get(radius, ())) == 1:
        return {radius: [numbers[radius][0] * GROW**steps]}
    eye, target = (np.array(numbers[f"camera.{key}"]) for key in ("position", "look_at"))
    return {"camera.position": (target + (eye - target) * NEARER**steps).tolist()}
