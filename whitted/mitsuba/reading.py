"""From a dictionary of Mitsuba to one of a scene file."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from . import glass
from .camera import camera, clipped
from .lights import light
from .node import Node, type_of
from .report import Report
from .shapes import Placed, shape
from .walls import closed_room

# The groups of a scene file; the names of an exported scene may begin with one (`writing.py`)
SHAPES = "spheres", "planes", "discs"
GROUPS = *SHAPES, "lights", "materials"
# The depth that stands for an endless one
DEEP = 10
# `max_depth` where it is not given, and that of the differentiable integrators
ENDLESS, DIFFERENTIABLE = -1, 6
DARKER = "Mitsuba also follows light from one matte surface to another; this is darker without it"
SCALED = "the eye or a light is inside this glass: Mitsuba scales radiance there, whitted does not"
LIT = "in Mitsuba the sky lights matte surfaces, and the background here does not"


def read(source: Mapping[str, Any], approximate: bool = False) -> tuple[dict[str, Any], Report]:
    """The dictionary of a scene file, and what was found on the way.

    Args:
        source: a dictionary as `mitsuba.load_dict` takes it, of the type "scene".
        approximate: whether to take what has no exact counterpart, with a warning.
    """
    report = Report(approximate)
    root = Node("", source, report, dict(_ids("", source)))
    if root.type != "scene":
        report.refuse(root.told("type"), "expected 'scene'")
        return {}, report
    root.children("bsdf", "texture")
    found = (shape(node, _name(node)) for node in root.children("shape"))
    placed = sorted(filter(None, found), key=lambda each: SHAPES.index(each.group))
    eye, sensor = _camera(root)
    lights, sky = _lights(root)
    materials, made_of = _materials(source, placed, report)
    scene = {
        "camera": eye,
        "materials": materials,
        "lights": lights,
        "max_depth": _depth(root, placed, sky is not None),
        **{
            group: [
                {**each.table, "material": material}
                for each, material in zip(placed, made_of, strict=True)
                if each.group == group
            ]
            for group in SHAPES
        },
    }
    if sky is not None:
        radiance = sky.color("radiance", 1)
        scene["background"] = radiance
        sky.ignore("sampling_weight")
        sky.finish()
        if max(radiance) > 0 and any(map(_is_matte, placed)):
            report.differ(sky.path, LIT, "it is seen, and lights nothing")
    root.finish()
    if sensor is not None:
        _compare(scene, placed, sensor, report)
    return scene, report


def _ids(path: str, table: Mapping[str, Any]) -> Iterator[tuple[str, tuple[str, Mapping]]]:
    """The names that references may use: keys, and ids."""
    for key, value in table.items():
        if isinstance(value, Mapping) and type_of(value) != "ref":
            where = f"{path}.{key}" if path else str(key)
            if not path:
                yield str(key), (where, value)
            if "id" in value:
                yield str(value["id"]), (where, value)
            yield from _ids(where, value)


def _name(node: Node) -> str:
    return plain(node.name)


def plain(key: str) -> str:
    """The name of what has some key in an exported scene.

    Where the name itself is no key, it has its group before it, and "@" and a shape after it where
    a material is several BSDFs.
    """
    group, _, name = key.partition("-")
    if group not in GROUPS or not name:
        return key
    return name.partition("@")[0] if group == "materials" else name


def _camera(root: Node) -> tuple[dict[str, Any], Node | None]:
    sensors = root.children("sensor")
    if not sensors:
        root.report.refuse("sensor", "missing; expected a perspective sensor")
    for more in sensors[1:]:
        root.report.differ(more.path, "a second sensor; expected one", "the first is taken")
    if not sensors or not sensors[0].taken():
        return {}, None
    return camera(sensors[0]), sensors[0]


def _lights(root: Node) -> tuple[list[dict[str, Any]], Node | None]:
    """The lights, and the constant emitter."""
    emitters = [node for node in root.children("emitter") if node.taken()]
    skies = [node for node in emitters if node.type == "constant"]
    for more in skies[1:]:
        root.report.refuse(more.path, "a second constant emitter; expected one")
    lights = [light(node, _name(node)) for node in emitters if node.type != "constant"]
    return lights, skies[0] if skies else None


def _materials(
    source: Mapping[str, Any], placed: Sequence[Placed], report: Report
) -> tuple[dict[str, dict], list[str]]:
    """Materials by name, in the order of their BSDFs, and the name of that of each shape."""
    found: dict[str, dict] = {}
    places: dict[str, int] = {}
    names = []
    for each, ior in zip(placed, _indices(placed, report), strict=True):
        keys = {**each.surface.keys, **({} if ior is None else {"ior": ior})}
        own = plain(each.surface.name)
        name, more = own, 2
        while found.get(name, keys) != keys:
            name, more = f"{own}{more}", more + 1
        found[name] = keys
        top = each.surface.path.partition(".")[0]
        places.setdefault(name, list(source).index(top) if top in source else len(source))
        names.append(name)
    return {name: found[name] for name in sorted(found, key=lambda name: places[name])}, names


def _indices(placed: Sequence[Placed], report: Report) -> list[float | None]:
    """The index of refraction of each shape's glass; None where it has none."""
    for each in placed:
        if each.surface.indices is not None and each.group != "spheres":
            report.refuse(each.path, "glass without a volume has no counterpart; expected a sphere")
    clear = [each for each in placed if _is_glass(each)]
    balls = [each.ball for each in clear]
    for i, k in glass.crossing(balls):
        why = f"this glass overlaps with '{clear[i].path}'"
        report.differ(clear[k].path, why, "the smaller of the two fills what both contain")
    outer = glass.around(balls)
    inside: dict[int | None, float] = {None: 1.0}
    for i in sorted(range(len(balls)), key=lambda i: -balls[i][1]):
        within, outside = clear[i].surface.indices or (1.0, 1.0)
        around = inside[outer[i]]
        inside[i] = within if outside == around else within / outside * around
    found = iter([inside[i] for i in range(len(balls))])
    return [next(found) if _is_glass(each) else None for each in placed]


def _is_glass(each: Placed) -> bool:
    return each.surface.indices is not None and each.group == "spheres"


def _is_matte(each: Placed) -> bool:
    return max(each.surface.keys.get("color", [0.0])) > 0


def _depth(root: Node, placed: Sequence[Placed], sky: bool) -> int:
    """The scene's depth.

    Mitsuba counts the segments of a path, and the last one leads to a light. A node here sees the
    lights by itself, so that its chains have one node less than Mitsuba's paths have segments;
    except where all light is the sky, which a chain of n nodes sees over n segments.
    """
    matte = any(map(_is_matte, placed))
    bent = any(_is_glass(each) or each.surface.keys.get("reflection", 0) for each in placed)
    node = root.child("integrator") or Node("integrator", {"type": "path"}, root.report, root.ids)
    if not node.taken():
        return 1
    segments = _segments(node, sky, least=1 if sky and not matte else 2)
    if matte and len(placed) > 1 and segments not in (1, 2):
        root.report.warn(node.at("max_depth"), DARKER)
    if segments == ENDLESS:
        if bent:
            why = "paths without an end have no counterpart; expected a whole number"
            root.report.differ(node.at("max_depth"), why, f"max_depth is {DEEP} here")
        return DEEP if bent else 1
    return segments if sky and not matte else segments - 1


def _segments(node: Node, sky: bool, least: int) -> int:
    """The number of segments of an integrator's longest path."""
    node.ignore("rr_depth", "emitter_samples", "bsdf_samples", "shading_samples")
    if node.flag("hide_emitters") and sky:
        node.report.refuse(node.told("hide_emitters"), "the sky is seen here; expected False")
    if node.type.startswith("direct"):
        segments = 2
    else:
        usual = ENDLESS if node.type == "path" else DIFFERENTIABLE
        segments = node.whole("max_depth", usual, ENDLESS)
        if segments != ENDLESS and segments < least:
            node.expect("max_depth", f"{least} or more: shorter paths see nothing but sources")
            segments = least
    if not node.type.startswith(("path", "direct")) or node.type == "direct_projective":
        # What the others say of derivatives
        node.ignore(*node.table)
    node.finish()
    return segments


def _compare(
    scene: Mapping[str, Any], placed: Sequence[Placed], sensor: Node, report: Report
) -> None:
    """What only the whole scene tells."""
    eye = np.array(scene["camera"]["position"])
    points = [eye, *(np.array(own["position"]) for own in scene["lights"] if "position" in own)]
    solid = [each for each in placed if each.group != "planes"]
    clipped(sensor, {each.path: each.ball for each in solid}, eye)
    # Rectangles
    walls = [each.wall for each in placed if each.group == "planes" and each.wall]
    closed = bool(walls) and closed_room(walls, points)
    for each in placed:
        if each.group == "planes" and not closed:
            why = "a rectangle has no counterpart, unless all rectangles close a room"
            report.differ(each.path, why, "an infinite plane takes its place")
    # Backs, which are seen by the eye, or by what is behind
    for each in placed:
        if each.wall:
            others = [] if closed else [own for own in solid if own is not each]
            reaches = [own.along(each.wall.normal) for own in others]
            seen = each.wall.behind([(eye, 0.0), *reaches])
        else:
            seen = glass.contains(each.ball, eye)
        if seen and each.surface.one_sided:
            report.warn(
                each.path, "its back can be seen: it is black in Mitsuba, and like its front here"
            )
    # Glass
    for each in filter(_is_glass, placed):
        if any(glass.contains(each.ball, point) for point in points):
            report.warn(each.path, SCALED)
