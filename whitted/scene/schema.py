"""What is wrong with a scene file: a line for each problem."""

import difflib
import json
import re
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel, ValidationError

from ..core.parameter import parameters_of
from ..lights import LIGHTS
from ..shapes import SHAPES
from .camera import direction, view_problem
from .scene import MAX_OBJECTS
from .tables import (
    GROUPS,
    LIGHT_TABLES,
    SHAPE_TABLES,
    CameraTable,
    CheckerTable,
    MaterialTable,
    SceneTable,
    VectorTable,
    light_type,
)


def problems(raw: dict[str, Any]) -> list[str]:
    """A line for each problem: dotted path, value, what was expected."""
    found = []
    try:
        SceneTable.model_validate(raw)
    except ValidationError as error:
        found = [_describe(problem) for problem in error.errors(include_url=False)]
    return found + _cross_problems(raw)


def _describe(problem: Any) -> str:
    path, kind = problem["loc"], problem["type"]
    where = _dotted(path)
    if kind == "extra_forbidden":
        return f"{where}: unknown key{_nearest(str(path[-1]), _table_at(path[:-1]).model_fields)}"
    if kind == "missing":
        return f"{where}: missing; {_expected(path)}"
    value = _shorten(problem["input"])
    if kind == "value_error":
        return f"{where} = {value}: {problem['ctx']['error']}"
    if kind == "literal_error":
        known = get_args(_table_at(path[:-1]).model_fields[path[-1]].annotation)
        near = _nearest(str(problem["input"]), known)
        return f"{where} = {value}: expected {_choices(known)}{near}"
    if kind == "union_tag_invalid":
        name = problem["input"]["type"]
        near = _nearest(str(name), LIGHTS)
        return f"{where}.type = {_shorten(name)}: expected {_choices(LIGHTS)}{near}"
    expected = {"bool_type": "true or false", "list_type": "a list of tables"}.get(kind, "a table")
    return f"{where} = {value}: expected {expected}"


def _choices(names: Any) -> str:
    *most, last = (f"'{name}'" for name in names)
    return f"{', '.join(most)} or {last}"


def _table_at(path: tuple[Any, ...]) -> type[BaseModel]:
    """The model of the table at a path. A light's path has the type of its table in third place."""
    if not path:
        return SceneTable
    if path[0] == "camera":
        return CameraTable
    if path[0] == "lights":
        return LIGHT_TABLES[path[2]]
    if path[0] in SHAPE_TABLES:
        return SHAPE_TABLES[path[0]]
    return CheckerTable if "checker" in path[2:] else MaterialTable


def _expected(path: tuple[Any, ...]) -> str:
    """What a key's check asks for."""
    for check in _table_at(path[:-1]).model_fields[path[-1]].metadata:
        try:
            check.func(None)
        except ValueError as error:
            return str(error)
    return "expected a table"


def _cross_problems(raw: dict[str, Any]) -> list[str]:
    """What no key alone can tell. Tables that are not of the right type were reported already."""
    groups = {group: _tables(raw, group) for group in (*GROUPS, "lights")}
    count = sum(len(tables) for tables in groups.values())
    if count > MAX_OBJECTS:
        return [f"{count} shapes and lights: expected at most {MAX_OBJECTS}"]
    found = _camera_problems(_as_table(raw.get("camera")))
    for group, tables in groups.items():
        seen: dict[str, int] = {}
        for i, table in tables:
            name = table.get("name", default_name(group, i))
            if isinstance(name, str) and seen.setdefault(name, i) != i:
                taken = f"taken by {group}[{seen[name]}]; names are unique"
                found.append(f"{group}[{i}].name = {_shorten(name)}: {taken}")
            if group in GROUPS:
                found += _material_problems(_as_table(raw.get("materials")), group, i, table)
            kind: Any = GROUPS.get(group) or LIGHTS.get(light_type(table))
            found += _direction_problems(f"{group}[{i}]", kind, table) if kind else []
    return found


def default_name(group: str, place: int) -> str:
    """The name of a thing that a file gives none."""
    return f"{group[:-1]}{place}"


def _tables(raw: dict[str, Any], group: str) -> list[tuple[int, dict]]:
    items = raw.get(group)
    items = items if isinstance(items, list) else []
    return [(i, item) for i, item in enumerate(items) if isinstance(item, dict)]


def _as_table(value: object) -> dict:
    return value if isinstance(value, dict) else {}


def _material_problems(materials: dict, group: str, i: int, table: dict) -> list[str]:
    name = table.get("material")
    where = f"{group}[{i}].material = {_shorten(name)}"
    if isinstance(name, str) and name not in materials:
        near = _nearest(name, materials) or ("" if materials else "; the file has no materials")
        return [f"{where}: there is no such material{near}"]
    if isinstance(name, str) and not GROUPS[group].flat and "checker" in _as_table(materials[name]):
        *most, last = (kind.group for kind in SHAPES if kind.flat)
        flat = f"{', '.join(most)} and {last}"
        return [f"{where}: has a checker, which only {flat} can show"]
    return []


def _direction_problems(where: str, kind: Any, table: dict) -> list[str]:
    found = []
    for name, entry in parameters_of(kind).items():
        value = _vector_or_none(table.get(name)) if entry.legal.direction else None
        if value is not None and not direction(value).any():
            found.append(
                f"{where}.{name} = {_shorten(table[name])}: expected a direction, not zero"
            )
    return found


def _camera_problems(camera: dict) -> list[str]:
    position, look_at = (_vector_or_none(camera.get(key)) for key in ("position", "look_at"))
    up = _vector_or_none(camera.get("up", [0, 1, 0]))
    if position is None or look_at is None:
        return []
    wrong = view_problem(position, look_at, up)
    if wrong is None:
        return []
    field, expected = wrong
    return [f"camera.{field} = {_shorten(camera.get(field, [0, 1, 0]))}: {expected}"]


def _vector_or_none(value: object) -> np.ndarray | None:
    try:
        return np.array(VectorTable.model_validate({"value": value}).value)
    except ValidationError:
        return None


def _dotted(path: tuple[Any, ...]) -> str:
    """A path as a message writes it, without the type of a light's table."""
    path = (*path[:2], *path[3:]) if path[0] == "lights" else path
    text = ""
    for part in path:
        plain = isinstance(part, int) or re.fullmatch(r"[\w-]+", part)
        text += (
            f"[{part}]"
            if isinstance(part, int)
            else f".{part}"
            if plain
            else f".{json.dumps(part)}"
        )
    return text.lstrip(".")


def _shorten(value: object) -> str:
    try:
        text = json.dumps(value, default=str)
    except (ValueError, RecursionError):
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def _nearest(name: str, known: Any) -> str:
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean '{near[0]}'?" if near else ""
