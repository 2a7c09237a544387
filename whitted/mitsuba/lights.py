"""Emitters and lights.

A matte surface reflects albedo / pi of the irradiance in Mitsuba, and the albedo of it here. So
lights here have a part 1 / pi of Mitsuba's intensity.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from .node import CLOSE, Node
from .report import Report, equals


def light(node: Node, name: str) -> dict[str, Any]:
    """The light of an emitter, a point or directional one."""
    node.ignore("sampling_weight")
    if node.type == "point":
        found = {
            "name": name,
            "position": _position(node).tolist(),
            "intensity": _over_pi(node.color("intensity", 1)),
            "falloff": "inverse-square",
        }
    else:
        found = {
            "name": name,
            "type": "directional",
            "direction": _direction(node).tolist(),
            "irradiance": _over_pi(node.color("irradiance", 1)),
        }
    node.finish()
    return found


def _over_pi(color: list[float]) -> list[float]:
    return [channel / math.pi for channel in color]


def _position(node: Node) -> np.ndarray:
    if node.has("position") and node.has("to_world"):
        node.report.refuse(node.at("to_world"), "expected either this or position")
    return (
        node.vector("position", (0, 0, 0))
        if node.has("position")
        else (node.matrix("to_world")[:3, 3])
    )


def _direction(node: Node) -> np.ndarray:
    if not node.has("direction"):
        return node.matrix("to_world")[:3, 2]
    if node.has("to_world"):
        node.report.refuse(node.at("to_world"), "expected either this or direction")
    direction = node.vector("direction", (0, 0, 1))
    if abs(direction).max() < CLOSE * CLOSE:
        node.expect("direction", "a direction, not zero")
    return direction


def emitter(light: Mapping[str, Any], report: Report, center: np.ndarray) -> dict[str, Any]:
    """The emitter of a light.

    Args:
        center: where a light that does not fall off, which is approximated, is as bright as here.
    """
    if light["type"] == "directional":
        return {
            "type": "directional",
            "direction": list(light["direction"]),
            "irradiance": _times_pi(light["irradiance"], 1),
        }
    if light["type"] != "point":
        told = equals(f"lights.{light['name']}.type", light["type"])
        report.refuse(told, "has no counterpart in Mitsuba")
        return {}
    gain = 1.0
    if light["falloff"] == "none":
        gain = float(np.sum(np.square(center - light["position"]))) or 1.0
        report.differ(
            equals(f"lights.{light['name']}.falloff", "none"),
            "Mitsuba's lights fall off with the squared distance",
            "it is made as bright as here at camera.look_at",
        )
    return {
        "type": "point",
        "position": list(light["position"]),
        "intensity": _times_pi(light["intensity"], gain),
    }


def _times_pi(color: list[float], gain: float) -> dict[str, Any]:
    return {"type": "rgb", "value": [channel * math.pi * gain for channel in color]}
