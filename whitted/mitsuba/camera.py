"""Perspective sensors and the camera."""

import math
import re
from collections.abc import Mapping
from typing import Any

import drjit as dr
import numpy as np

from .node import CLOSE, Node
from .walls import Ball

AXES = ("x", "y", "diagonal", "smaller", "larger")
# Half the diagonal of 35 mm film
HALF_FILM = math.hypot(36, 24) / 2
# Far and near clipping planes of an exported scene, by its size; nearer shapes take a nearer one
CLIP = 1000.0
UP = np.array([0.0, 1, 0])


def camera(node: Node) -> dict[str, Any]:
    """The camera of a sensor."""
    resolution = _film(node)
    # `clipped` reads the first two
    node.ignore("near_clip", "far_clip", "shutter_open", "shutter_close")
    node.children("sampler")
    for key in ("principal_point_offset_x", "principal_point_offset_y"):
        if node.number(key, 0):
            node.report.refuse(node.told(key), "has no counterpart; expected 0")
    fov = _fov(node, *resolution)
    position, look_at, up = _view(node, node.number("focus_distance", 1, 0, open_=True))
    node.finish()
    return {
        "position": position.tolist(),
        "look_at": look_at.tolist(),
        "up": up.tolist(),
        "fov": fov,
        "resolution": list(resolution),
    }


def _film(node: Node) -> tuple[int, int]:
    film = node.child("film")
    if film is None:
        film = Node(node.at("film"), {"type": "hdrfilm"}, node.report, node.ids)
    if not film.taken():
        return 768, 576
    size = film.whole("width", 768, 1), film.whole("height", 576, 1)
    film.ignore("file_format", "pixel_format", "component_format", "sample_border", "compensate")
    for key, usual in (
        ("crop_width", size[0]),
        ("crop_height", size[1]),
        ("crop_offset_x", 0),
        ("crop_offset_y", 0),
    ):
        if film.whole(key, usual, 0) != usual:
            film.report.refuse(film.told(key), f"crops have no counterpart; expected {usual}")
    rfilter = film.child("rfilter")
    kind = rfilter.type if rfilter else "gaussian"
    if kind != "box":
        where = rfilter.path if rfilter else film.at("rfilter")
        what = f"Mitsuba blurs pixels by a '{kind}' filter; here each is the mean of its square"
        film.report.warn(where, f"{what}, as by 'box'")
    film.finish()
    return size


def _fov(node: Node, width: int, height: int) -> float:
    """The vertical field of view in degrees."""
    axis = node.word("fov_axis", "x", AXES)
    if node.has("fov"):
        fov = node.number("fov", 45, 0, open_=True)
        if fov >= 180:
            node.expect("fov", "an angle in degrees, in (0, 180)")
        if node.has("focal_length"):
            node.report.refuse(node.at("focal_length"), "expected either this or fov")
    else:
        fov, axis = math.degrees(2 * math.atan(HALF_FILM / _focal_length(node))), "diagonal"
    if axis in ("smaller", "larger"):
        axis = "x" if (width < height) == (axis == "smaller") else "y"
    if axis == "y":
        return fov
    across = width if axis == "x" else math.hypot(width, height)
    return math.degrees(2 * math.atan(math.tan(math.radians(fov) / 2) * height / across))


def _focal_length(node: Node) -> float:
    """The focal length in mm; it is given for 35 mm film."""
    value = node.table["focal_length"] if node.has("focal_length") else "50mm"
    text = value.removesuffix("mm").strip() if isinstance(value, str) else ""
    if not re.fullmatch(r"\d*\.?\d+", text) or float(text) == 0:
        node.expect("focal_length", "a length such as '50mm'")
        return 50.0
    return float(text)


def _view(node: Node, distance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the eye is, the point before it at a distance, and the direction that is up."""
    matrix = node.matrix("to_world")
    turn, position = matrix[:3, :3], matrix[:3, 3]
    if not np.allclose(turn.T @ turn, np.eye(3), atol=10 * CLOSE) or np.linalg.det(turn) < 0:
        node.expect("to_world", "a rotation and a translation: no scale, no shear, no mirroring")
        return position, position + [0, 0, distance], UP
    right, up, forward = turn[:, 0], turn[:, 1], turn[:, 2]
    # Where the default `up` gives the same view, it is taken
    usual = abs(right @ UP) < CLOSE and up @ UP > CLOSE
    look_at = _tidy(position + distance * forward, distance + abs(position).max())
    return position, look_at, UP if usual else up


def _tidy(point: np.ndarray, size: float) -> np.ndarray:
    """A point without its last digits, which are rounding errors of lengths of some size."""
    unit = 10.0 ** math.ceil(math.log10(size))
    return np.round(point / unit, 14) * unit


def clipped(node: Node, balls: Mapping[str, Ball], eye: np.ndarray) -> None:
    """A warning for each shape that the sensor's clipping planes may cut off.

    Args:
        balls: spheres, or spheres around other shapes, by their paths.
    """
    near, far = node.number("near_clip", 1e-2, 0, open_=True), node.number("far_clip", 1e4, 0)
    for path, (center, radius) in balls.items():
        distance = float(np.linalg.norm(center - eye))
        cuts = {"near_clip": abs(distance - radius) < near, "far_clip": distance + radius > far}
        for key in (key for key, cut in cuts.items() if cut):
            what = f"Mitsuba may cut off parts of it, by {node.at(key)}; nothing is cut off here"
            node.report.warn(path, what)


def sensor(camera: Mapping[str, Any], nearest: float, reach: float) -> dict[str, Any]:
    """The sensor of a camera.

    Args:
        nearest, reach: the distances from the eye between which all finite shapes are.
    """
    position, look_at = np.array(camera["position"], float), np.array(camera["look_at"], float)
    distance = float(np.linalg.norm(look_at - position))
    forward = (look_at - position) / distance
    left = np.cross(camera["up"], forward)
    left /= np.linalg.norm(left)
    to_world = np.eye(4)
    to_world[:3] = np.array([left, np.cross(forward, left), forward, position]).T
    width, height = camera["resolution"]
    return {
        "type": "perspective",
        "fov": camera["fov"],
        "fov_axis": "y",
        "to_world": dr.scalar.Matrix4f64(to_world),
        "focus_distance": distance,
        "near_clip": max(min(reach, nearest * CLIP / 2) / CLIP, reach / CLIP**2),
        "far_clip": reach * CLIP * 10,
        "film": {
            "type": "hdrfilm",
            "width": width,
            "height": height,
            "pixel_format": "rgb",
            "rfilter": {"type": "box"},
        },
    }
