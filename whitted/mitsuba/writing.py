"""From a dictionary of a scene file to one of Mitsuba."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from . import glass
from .camera import sensor
from .lights import emitter
from .reading import GROUPS, LIT, SCALED, SHAPES, plain
from .report import Report, equals
from .surfaces import bsdf
from .walls import FAR, Ball, Wall, room_of, upright

# What of a scene file is written
KNOWN = {*GROUPS, "camera", "background", "ambient", "max_depth", "min_importance"}
BRIGHTER = "Mitsuba also follows light from one matte surface to another; it is brighter there"
# Keys of the scene itself
OWN = "type", "id", "integrator", "sensor", "sky"


@dataclass(frozen=True)
class Thing:
    """A shape: its table here, and its plugin without a material."""

    group: str
    table: Mapping[str, Any]
    plugin: dict[str, Any]
    # The index of refraction around it, if it is of glass
    around: float = 1.0
    # Whether its back can be seen
    two_sided: bool = True
    # Of a plane
    wall: Wall | None = None

    @property
    def path(self) -> str:
        return f"{self.group}.{self.table['name']}"


def write(scene: Mapping[str, Any], approximate: bool = False) -> tuple[dict[str, Any], Report]:
    """A dictionary as `mitsuba.load_dict` takes it, and what was found on the way.

    Args:
        scene: the dictionary of a scene file, with a value for every key of a thing, and a name for
            each shape and light.
        approximate: whether to write what has no exact counterpart, with a warning.
    """
    report = Report(approximate)
    for key in scene:
        if key not in KNOWN:
            report.refuse(key, "has no counterpart in Mitsuba")
    scene = {**dict.fromkeys((*SHAPES, "lights"), ()), "materials": {}, **scene}
    eye, look_at = (np.array(scene["camera"][key]) for key in ("position", "look_at"))
    lamps = [np.array(each["position"]) for each in scene["lights"] if "position" in each]
    solid = [_ball(each) for group in ("spheres", "discs") for each in scene[group]]
    points = [(point, 0.0) for point in (look_at, *lamps)]
    reach = max(float(np.linalg.norm(center - eye)) + own for center, own in [*points, *solid])
    gaps = (abs(float(np.linalg.norm(center - eye)) - own) for center, own in solid)
    things = [
        *_spheres(scene, [eye, *lamps], report),
        *_planes(scene, [eye, *lamps], reach, report),
        *(Thing("discs", own, _flat("disk", _rim(own))) for own in scene["discs"]),
    ]
    segments = _segments(scene, report)
    taken = set(OWN)
    keys = [_key(taken, thing.group, thing.table["name"]) for thing in things]
    lights = {
        _key(taken, "lights", own["name"]): emitter(own, report, look_at) for own in scene["lights"]
    }
    bsdfs, made_of = _bsdfs(scene, things, taken, report)
    shapes = {
        key: {**thing.plugin, "bsdf": {"type": "ref", "id": name}}
        for key, thing, name in zip(keys, things, made_of, strict=True)
    }
    written = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": segments},
        "sensor": sensor(scene["camera"], min(gaps, default=reach), reach),
        **bsdfs,
        **shapes,
        **lights,
        **_sky(scene),
    }
    return written, report


def _ball(table: Mapping[str, Any]) -> Ball:
    return np.array(table["center"]), table["radius"]


def _key(taken: set[str], group: str, name: str) -> str:
    """A key that is not taken yet: the name itself if possible, or with the group before it.

    Args:
        group: empty for a name that has it already.
    """
    key = name.replace(".", "_")
    if group and (key in taken or plain(key) != key):
        key = f"{group}-{key}"
    while key in taken:
        key += "_"
    taken.add(key)
    return key


def _spheres(scene: Mapping[str, Any], points: Sequence[np.ndarray], report: Report) -> list[Thing]:
    """Spheres, and what is around those of glass.

    Args:
        points: the eye, and the point lights.
    """
    spheres, materials = scene["spheres"], scene["materials"]
    clear = [own for own in spheres if materials[own["material"]]["refraction"]]
    balls = [_ball(own) for own in clear]
    for i, k in glass.crossing(balls):
        why = f"this glass overlaps with 'spheres.{clear[i]['name']}'"
        report.differ(
            f"spheres.{clear[k]['name']}",
            why,
            "in Mitsuba each keeps its own index where they overlap",
        )
    for own, ball in zip(clear, balls, strict=True):
        if any(glass.contains(ball, point) for point in points):
            report.warn(f"spheres.{own['name']}", SCALED)
    indices = [
        1.0 if k is None else materials[clear[k]["material"]]["ior"] for k in glass.around(balls)
    ]
    around = {own["name"]: index for own, index in zip(clear, indices, strict=True)}
    return [
        Thing(
            "spheres",
            own,
            {"type": "sphere", "center": list(own["center"]), "radius": own["radius"]},
            around.get(own["name"], 1.0),
            two_sided=glass.contains(_ball(own), points[0]),
        )
        for own in spheres
    ]


def _planes(
    scene: Mapping[str, Any], points: Sequence[np.ndarray], reach: float, report: Report
) -> list[Thing]:
    """Rectangles that look like the planes; large ones where there are none."""
    numbers = [(np.array(own["normal"]), own["offset"]) for own in scene["planes"]]
    walls = room_of(numbers, points)
    if not walls:
        for own, (normal, offset) in zip(scene["planes"], numbers, strict=True):
            side = FAR * max(reach, abs(normal @ points[0] + offset))
            why = "a plane that is not a wall of a closed room has no counterpart"
            report.differ(
                f"planes.{own['name']}", why, f"a square of half side {side:.3g} is taken"
            )
            walls.append(upright(normal, offset, points[0], side))
    return [
        Thing("planes", own, _flat("rectangle", wall), wall=wall)
        for own, wall in zip(scene["planes"], walls, strict=True)
    ]


def _rim(table: Mapping[str, Any]) -> Wall:
    center, radius = _ball(table)
    normal = np.array(table["normal"])
    return upright(normal, -float(normal @ center), center, radius)


def _flat(kind: str, wall: Wall) -> dict[str, Any]:
    to_world = np.eye(4)
    to_world[:3] = np.array([wall.u, wall.v, wall.normal, wall.center]).T
    return {"type": kind, "to_world": dr.scalar.Matrix4f64(to_world)}


def _bsdfs(
    scene: Mapping[str, Any], things: Sequence[Thing], taken: set[str], report: Report
) -> tuple[dict[str, dict], list[str]]:
    """BSDFs by key, in the order of the materials, and the key of that of each shape.

    A material is one BSDF; but glass is one for each medium around it, and a checkerboard one for
    each plane.
    """
    materials = scene["materials"]
    both = {thing.table["material"] for thing in things if thing.two_sided}
    variants = [
        (
            thing.table["material"],
            thing.around,
            thing.path if materials[thing.table["material"]].get("checker") else None,
        )
        for thing in things
    ]
    for thing in things:
        if thing.group != "spheres" and materials[thing.table["material"]]["refraction"]:
            report.refuse(thing.path, "glass without a volume has no counterpart in Mitsuba")
    order = {name: place for place, name in enumerate(materials)}
    keys: dict[tuple, str] = {}
    found = {}
    for variant, thing in sorted(
        zip(variants, things, strict=True), key=lambda pair: order[pair[0][0]]
    ):
        if variant in keys:
            continue
        name = variant[0]
        again = any(other[0] == name for other in keys)
        own = f"materials-{name}@{thing.table['name']}" if again else name
        keys[variant] = _key(taken, "" if again else "materials", own)
        found[keys[variant]] = bsdf(
            name, materials[name], report, thing.around, name in both, thing.wall
        )
    return found, [keys[variant] for variant in variants]


def _segments(scene: Mapping[str, Any], report: Report) -> int:
    """The number of segments of the longest path; `reading.py` tells how that counts."""
    materials = scene["materials"]
    shapes = [own for group in SHAPES for own in scene[group]]
    matte = any(
        max(*materials[own["material"]]["color"], *_board(materials[own["material"]])) > 0
        for own in shapes
    )
    sky, depth = any(scene["background"]), scene["max_depth"]
    if any(scene["ambient"]):
        told = equals("ambient", scene["ambient"])
        report.differ(told, "has no counterpart in Mitsuba", "it is left out")
    if scene["min_importance"]:
        told = equals("min_importance", scene["min_importance"])
        report.differ(told, "has no counterpart in Mitsuba", "it is left out")
    if sky and matte:
        report.differ(equals("background", scene["background"]), LIT, "it is written as a sky")
    if matte and len(shapes) > 1 and depth > 1:
        report.warn("max_depth", BRIGHTER)
    return depth if sky and not matte else depth + 1


def _board(material: Mapping[str, Any]) -> list[float]:
    return material["checker"]["color"] if material.get("checker") else [0.0]


def _sky(scene: Mapping[str, Any]) -> dict[str, Any]:
    if not any(scene["background"]):
        return {}
    radiance = {"type": "rgb", "value": list(scene["background"])}
    return {"sky": {"type": "constant", "radiance": radiance}}
