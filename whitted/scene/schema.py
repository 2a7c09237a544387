"""What is wrong with a scene, or with one thing of it: a line for each problem.

A scene is given as the tables of its file, in Python's own numbers.
"""

import difflib
import json
import re
from collections.abc import Callable, Sequence
from typing import Any, get_args

import drjit as dr
import numpy as np
from pydantic import BaseModel, ValidationError

from ..core.parameter import parameters_of
from ..lights import LIGHTS
from ..shapes import SHAPES
from .camera import Camera, direction, view_problem
from .tables import (
    GROUPS,
    LIGHT_TABLES,
    MAX_OBJECTS,
    SHAPE_TABLES,
    CameraTable,
    CheckerTable,
    MaterialTable,
    SceneTable,
    VectorTable,
    light_type,
)

# Keys and numbers that lead to a value
Path = tuple[Any, ...]


class SceneError(ValueError):
    """A scene, or a thing of one, that is not valid; the message has a line for each problem."""


def problems(raw: Any, named: bool = False) -> list[str]:
    """A line for each problem of a scene: dotted path, value, what was expected.

    Args:
        raw: the tables of a file.
        named: paths have the names of things, which all have one, in place of their numbers.
    """
    if not isinstance(raw, dict):
        return [f"expected the tables of a scene, got {_shorten(raw)}"]
    where = _by_name(raw) if named else _by_number
    return _own_problems(SceneTable, raw, where) + _cross_problems(raw, lambda *path: where(path))


def thing_problems(table: type[BaseModel], kind: Any, raw: dict[str, Any], where: str) -> list[str]:
    """A line for each problem that a thing has by itself.

    Args:
        table, kind: what the thing is.
        raw: its own table.
        where: the path to it.
    """
    found = _own_problems(table, raw, lambda path: where + _dotted(path, after=True))
    if kind is Camera:
        return found + _camera_problems(raw)
    return found + _direction_problems(where, kind, raw)


def _own_problems(
    table: type[BaseModel], raw: dict[str, Any], where: Callable[[Path], str]
) -> list[str]:
    """What each key tells by itself."""
    try:
        table.model_validate(raw)
    except ValidationError as error:
        return [_describe(problem, table, where) for problem in error.errors(include_url=False)]
    return []


def _describe(problem: Any, root: type[BaseModel], where: Callable[[Path], str]) -> str:
    path, kind = problem["loc"], problem["type"]
    # The name of a material that is none
    path = path[:-1] if path[-1:] == ("[key]",) else path
    if kind == "extra_forbidden":
        known = _table_at(root, path[:-1]).model_fields
        return f"{where(path)}: unknown key{nearest_or_all(str(path[-1]), known)}"
    if kind == "invalid_key":
        return f"{where(path)}: unknown key"
    if kind == "missing":
        return f"{where(path)}: missing; {_expected(root, path)}"
    if dr.is_array_v(problem["input"]):
        remedy = "give dr.detach of it here, and the array itself to Scene.replace"
        return f"{where(path)}: an array that carries gradients; {remedy}"
    told = f"{where(path)} = {_shorten(problem['input'])}"
    if kind == "value_error":
        return f"{told}: {problem['ctx']['error']}"
    if kind == "literal_error":
        choices = get_args(_table_at(root, path[:-1]).model_fields[path[-1]].annotation)
        return f"{told}: expected {_choices(choices)}{nearest(str(problem['input']), choices)}"
    if kind == "union_tag_invalid":
        name = problem["input"]["type"]
        near = nearest(str(name), LIGHTS)
        return f"{where(path)}.type = {_shorten(name)}: expected {_choices(LIGHTS)}{near}"
    expected = {"bool_type": "true or false", "list_type": "a list of tables"}.get(kind, "a table")
    # The only table of a thing that is made in Python
    expected = "a Checkerboard" if root is not SceneTable and expected == "a table" else expected
    return f"{told}: expected {expected}"


def _choices(names: Any) -> str:
    *most, last = (f"'{name}'" for name in names)
    return f"{', '.join(most)} or {last}"


def _table_at(root: type[BaseModel], path: Path) -> type[BaseModel]:
    """The model of the table at a path. A light's path has the type of its table in third place."""
    if not path:
        return root
    if root is not SceneTable:
        return CheckerTable
    if path[0] == "camera":
        return CameraTable
    if path[0] == "lights":
        return LIGHT_TABLES[path[2]]
    if path[0] in SHAPE_TABLES:
        return SHAPE_TABLES[path[0]]
    return CheckerTable if "checker" in path[2:] else MaterialTable


def _expected(root: type[BaseModel], path: Path) -> str:
    """What a key's check asks for."""
    for check in _table_at(root, path[:-1]).model_fields[path[-1]].metadata:
        try:
            check.func(None)
        except ValueError as error:
            return str(error)
    return "expected a table"


def _cross_problems(raw: dict[str, Any], where: Callable[..., str]) -> list[str]:
    """What no key alone can tell. Tables that are not of the right type were reported already."""
    groups = {group: _tables(raw, group) for group in (*GROUPS, "lights")}
    count = sum(len(own) for group, own in groups.items() if group not in ("spheres", "clouds"))
    if count > MAX_OBJECTS:
        told = f"{count} shapes and lights that are no spheres"
        return [f"{told}: expected at most {MAX_OBJECTS}"]
    found = _camera_problems(_as_table(raw.get("camera")))
    found += _board_problems(_as_table(raw.get("materials")), where)
    for group, tables in groups.items():
        seen: dict[str, int] = {}
        for i, table in tables:
            name = table.get("name", default_name(group, i))
            if isinstance(name, str) and seen.setdefault(name, i) != i:
                taken = f"taken by {where(group, seen[name])}; names are unique"
                found.append(f"{where(group, i)}.name = {_shorten(name)}: {taken}")
            if group in GROUPS:
                materials = _as_table(raw.get("materials"))
                found += _material_problems(where(group, i), materials, GROUPS[group], table)
            kind: Any = GROUPS.get(group) or LIGHTS.get(light_type(table))
            found += _direction_problems(where(group, i), kind, table) if kind else []
    return found


def default_name(group: str, place: int) -> str:
    """The name of a thing that a file gives none."""
    return f"{group[:-1]}{place}"


def _tables(raw: dict[str, Any], group: str) -> list[tuple[int, dict[str, Any]]]:
    items = raw.get(group)
    items = items if isinstance(items, list) else []
    return [(i, item) for i, item in enumerate(items) if isinstance(item, dict)]


def _as_table(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _material_problems(
    where: str, materials: dict[str, Any], kind: Any, table: dict[str, Any]
) -> list[str]:
    name = table.get("material")
    where = f"{where}.material = {_shorten(name)}"
    if isinstance(name, str) and name not in materials:
        near = nearest(name, materials) or ("" if materials else "; the scene has no materials")
        return [f"{where}: there is no such material{near}"]
    if (
        isinstance(name, str)
        and not kind.flat
        and _as_table(materials[name]).get("checker") is not None
    ):
        *most, last = (kind.group for kind in SHAPES if kind.flat)
        flat = f"{', '.join(most)} and {last}"
        return [f"{where}: has a checker, which only {flat} can show"]
    return []


def _board_problems(materials: dict[str, Any], where: Callable[..., str]) -> list[str]:
    """Materials with whose names parameters would have those of a checkerboard."""
    return [
        f"{where('materials', f'{name}.checker')}: taken by {where('materials', name, 'checker')}; "
        "names are unique"
        for name, table in materials.items()
        if f"{name}.checker" in materials and _as_table(table).get("checker") is not None
    ]


def _direction_problems(where: str, kind: Any, table: dict[str, Any]) -> list[str]:
    found = []
    for name, entry in parameters_of(kind).items():
        value = _vector_or_none(table.get(name)) if entry.legal.direction else None
        if value is not None and not direction(value).any():
            found.append(
                f"{where}.{name} = {_shorten(table[name])}: expected a direction, not zero"
            )
    return found


def _camera_problems(camera: dict[str, Any]) -> list[str]:
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


def _by_number(path: Path) -> str:
    """A path as a message writes it, without the type of a light's table."""
    return _dotted((*path[:2], *path[3:]) if path[0] == "lights" else path)


def _by_name(raw: dict[str, Any]) -> Callable[[Path], str]:
    """The same with the names of things in place of their numbers."""

    def where(path: Path) -> str:
        if len(path) < 2 or not isinstance(path[1], int):
            return _dotted(path)
        group, i, *rest = path
        name = raw[group][i]["name"]
        return f"{group}.{name}{_dotted(rest[1:] if group == 'lights' else rest, after=True)}"

    return where


def _dotted(path: Sequence[Any], after: bool = False) -> str:
    """A path as text; it may follow after another one."""
    text = ""
    for part in path:
        plain = isinstance(part, int) or re.fullmatch(r"[\w-]+", str(part))
        text += (
            f"[{part}]"
            if isinstance(part, int)
            else f".{part}"
            if plain
            else f".{json.dumps(part)}"
        )
    return text if after else text.lstrip(".")


def _shorten(value: object) -> str:
    if value is None:
        return "None"
    try:
        text = json.dumps(value, default=str)
    except (ValueError, RecursionError):
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def nearest_or_all(name: str, known: Any) -> str:
    """The known name that is most like another, or else all of them, as the end of a message."""
    return nearest(name, known) or f"; known are {', '.join(known)}"


def nearest(name: str, known: Any) -> str:
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean '{near[0]}'?" if near else ""
