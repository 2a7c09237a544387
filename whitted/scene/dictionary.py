"""A scene as the tables of its file."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..core.arrays import Precision
from ..core.parameter import Parameter, parameters_of, settings_of
from ..lights import LIGHTS
from .rows import Rows
from .schema import default_name
from .surroundings import Surroundings
from .tables import GROUPS, POINT, SceneTable

# The type of a kind of light, as a file names it
TYPES = {kind: name for name, kind in LIGHTS.items()}


def dictionary_of(scene: Any, whole: bool = False) -> dict[str, Any]:
    """The tables of a scene, with a name for each thing.

    Args:
        whole: also with what has its default.
    """
    numbers, precision = scene.numbers, scene.precision

    def parameters(kind: Any, prefix: str) -> dict[str, Any]:
        found = {}
        for field, entry in parameters_of(kind).items():
            own = [_written(entry, x, precision) for x in numbers[prefix + field]]
            if whole or own != [entry.default] * entry.size:
                found[field] = own if entry.size > 1 else own[0]
        return found

    def settings(entries: Mapping[str, Any], thing: Any) -> dict[str, Any]:
        values = {name: getattr(thing, name) for name in entries}
        return {name: own for name, own in values.items() if whole or own != entries[name].default}

    def table(thing: Any, prefix: str, **more: Any) -> dict[str, Any]:
        kind = type(thing)
        return {**more, **parameters(kind, prefix), **settings(settings_of(kind), thing)}

    of_scene = {name: SceneTable.model_fields[name] for name in ("max_depth", "min_importance")}
    tables = {
        **parameters(Surroundings, ""),
        **settings(of_scene, scene),
        "camera": table(scene.camera, "camera."),
    }
    if whole or scene.camera.up != (0, 1, 0):
        tables["camera"]["up"] = list(scene.camera.up)
    tables["camera"]["resolution"] = list(scene.resolution)
    materials = {}
    for material in scene.materials:
        prefix = f"materials.{material.name}."
        materials[material.name] = table(material, prefix)
        if material.checker is not None:
            materials[material.name]["checker"] = table(material.checker, f"{prefix}checker.")
    groups: dict[str, list[dict[str, Any]]] = {group: [] for group in GROUPS}
    for shape in scene.shapes:
        own = table(shape, f"{shape.group}.{shape.name}.", name=shape.name)
        groups[shape.group].append({**own, "material": shape.material})
    for cloud in scene.clouds:
        center, radius = (numbers[f"clouds.{cloud.name}.{field}"] for field in ("center", "radius"))
        rows = Rows(np.column_stack([center, radius]), cloud.file)
        own = {"name": cloud.name, "spheres": rows, "material": cloud.material}
        groups["clouds"].append(own)
    groups["lights"] = []
    for light in scene.lights:
        kind = TYPES[type(light)]
        more = {"type": kind} if whole or kind != POINT else {}
        groups["lights"].append(table(light, f"lights.{light.name}.", name=light.name, **more))
    filled = {"materials": materials, **groups}
    return tables | {group: own for group, own in filled.items() if own}


def with_rows(tables: Mapping[str, Any]) -> dict[str, Any]:
    """The same tables with Python's numbers for the spheres of clouds."""
    clouds = [
        own | {"spheres": Rows(own["spheres"].numbers).written()}
        for own in tables.get("clouds", ())
    ]
    return {**tables, **({"clouds": clouds} if clouds else {})}


def with_single_spheres(tables: Mapping[str, Any]) -> dict[str, Any]:
    """The same tables with a sphere for each one of a cloud."""
    rest = {key: own for key, own in tables.items() if key != "clouds"}
    more = [
        {
            "name": f"{cloud['name']}.{k}",
            "center": row[:3],
            "radius": row[3],
            "material": cloud["material"],
        }
        for cloud in tables.get("clouds", ())
        for k, row in enumerate(Rows(cloud["spheres"].numbers).written())
    ]
    return rest | {"spheres": [*tables.get("spheres", ()), *more]} if more else rest


def without_default_names(tables: Mapping[str, Any]) -> dict[str, Any]:
    """The same tables without the names that a file gives anyway."""

    def bare(group: str, things: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
        return [
            {
                key: own
                for key, own in thing.items()
                if (key, own) != ("name", default_name(group, i))
            }
            for i, thing in enumerate(things)
        ]

    return {
        key: bare(key, own) if key in (*GROUPS, "lights") else own for key, own in tables.items()
    }


def _written(entry: Parameter, x: float, precision: Precision) -> float:
    """The shortest decimal of a number. One that an optimiser has moved over a closed end of its
    range is that end.
    """
    if not entry.legal.open:
        x = min(max(x, entry.legal.low), entry.legal.high)
    return float(str(precision.dtype(x)))
