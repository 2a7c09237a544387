"""What a scene file may say: the keys, their values, and a line for each problem with them."""

import difflib
import json
import re
from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, StrictBool, ValidationError

from .scene import MAX_DEPTH, MAX_OBJECTS

# Squares of all lengths, and their reciprocals, fit single precision
LARGEST = 1e18

Number = Callable[[float], bool]


def _is_number(value: object, accepts: Number) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= LARGEST and accepts(value)


def _number(expected: str, accepts: Number) -> BeforeValidator:
    def check(value: Any) -> float:
        if not _is_number(value, accepts):
            raise ValueError(f"expected {expected}")
        return float(value)

    return BeforeValidator(check)


def _vector(expected: str, accepts: Number) -> BeforeValidator:
    def check(value: Any) -> list[float]:
        if not isinstance(value, list) or len(value) != 3 or not all(_is_number(x, accepts) for x in value):
            raise ValueError(f"expected {expected}")
        return [float(x) for x in value]

    return BeforeValidator(check)


def _depth(value: Any) -> int:
    if type(value) is not int or not 1 <= value <= MAX_DEPTH:
        raise ValueError(f"expected a whole number from 1 to {MAX_DEPTH}")
    return value


def _resolution(value: object) -> tuple[int, ...]:
    if not isinstance(value, list) or len(value) != 2 or not all(type(x) is int and 0 < x <= 1 << 20 for x in value):
        raise ValueError("expected [width, height], two whole numbers of pixels > 0")
    return tuple(value)


def _name(value: object) -> str:
    if not isinstance(value, str) or not value or not value.isprintable():
        raise ValueError("expected a name, a string that is not empty")
    return value


Real = Annotated[float, _number("a finite number", lambda x: True)]
Positive = Annotated[float, _number("a number > 0", lambda x: x >= 1 / LARGEST)]
NonNegative = Annotated[float, _number("a number >= 0", lambda x: x >= 0)]
Weight = Annotated[float, _number("a number in [0, 1]", lambda x: 0 <= x <= 1)]
Angle = Annotated[float, _number("an angle in degrees, in (0, 180)", lambda x: 0 < x < 180)]
Vector = Annotated[list[float], _vector("three finite numbers", lambda x: True)]
Color = Annotated[list[float], _vector("three numbers in [0, 1]", lambda x: 0 <= x <= 1)]
Name = Annotated[str, BeforeValidator(_name)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid")


class CameraTable(_Table):
    position: Vector
    look_at: Vector
    up: Vector = [0, 1, 0]
    fov: Angle
    resolution: Annotated[tuple[int, int], BeforeValidator(_resolution)]


class CheckerTable(_Table):
    color: Color
    size: Positive


class MaterialTable(_Table):
    color: Color = [0, 0, 0]
    specular: NonNegative = 0
    shininess: Positive = 50
    reflection: Weight = 0
    refraction: Weight = 0
    ior: Positive = 1.5
    fresnel: StrictBool = False
    checker: CheckerTable | None = None


class SphereTable(_Table):
    name: Name | None = None
    center: Vector
    radius: Positive
    material: Name


class PlaneTable(_Table):
    name: Name | None = None
    normal: Vector
    offset: Real
    material: Name


class LightTable(_Table):
    name: Name | None = None
    position: Vector
    intensity: Vector
    falloff: Literal["none", "inverse-square"] = "none"


class SceneTable(_Table):
    background: Vector = [0, 0, 0]
    ambient: Vector = [0, 0, 0]
    max_depth: Annotated[int, BeforeValidator(_depth)] = 5
    min_importance: Weight = 0
    camera: CameraTable
    materials: dict[Name, MaterialTable] = {}
    spheres: list[SphereTable] = []
    planes: list[PlaneTable] = []
    lights: list[LightTable] = []


def problems(raw: dict[str, Any]) -> list[str]:
    """A line for each problem: dotted path, value, what was expected."""
    found = []
    try:
        SceneTable.model_validate(raw)
    except ValidationError as error:
        found = [_describe(problem) for problem in error.errors(include_url=False)]
    return found + _cross_problems(raw)


def _describe(problem: Any) -> str:
    path, kind = _dotted(problem["loc"]), problem["type"]
    if kind == "extra_forbidden":
        return f"{path}: unknown key{_nearest(str(problem['loc'][-1]), list(_table_at(problem['loc'][:-1]).model_fields))}"
    if kind == "missing":
        return f"{path}: missing; {_expected(problem['loc'])}"
    value = _shorten(problem["input"])
    if kind == "value_error":
        return f"{path} = {value}: {problem['ctx']['error']}"
    if kind == "literal_error":
        near = _nearest(str(problem["input"]), ["none", "inverse-square"])
        return f"{path} = {value}: expected {problem['ctx']['expected']}{near}"
    expected = {"bool_type": "true or false", "list_type": "a list of tables"}.get(kind, "a table")
    return f"{path} = {value}: expected {expected}"


def _table_at(path: tuple[Any, ...]) -> type[BaseModel]:
    """The model of the table at a path."""
    if not path:
        return SceneTable
    models: dict[str, type[BaseModel]] = {
        "camera": CameraTable,
        "spheres": SphereTable,
        "planes": PlaneTable,
        "lights": LightTable,
    }
    return CheckerTable if "checker" in path[2:] else models.get(path[0], MaterialTable)


def _expected(path: tuple[Any, ...]) -> str:
    """What a key's check asks for."""
    for check in _table_at(path[:-1]).model_fields[path[-1]].metadata:
        try:
            check.func(None)
        except ValueError as error:
            return str(error)
    return "expected a table"


def _cross_problems(raw: dict[str, Any]) -> list[str]:
    """What no key alone can tell; tables that are not of the right type were reported already."""
    groups = {group: _tables(raw, group) for group in ("spheres", "planes", "lights")}
    count = sum(len(tables) for tables in groups.values())
    if count > MAX_OBJECTS:
        return [f"{count} spheres, planes and lights: expected at most {MAX_OBJECTS}"]
    found = _camera_problems(_as_table(raw.get("camera")))
    for group, tables in groups.items():
        seen: dict[str, int] = {}
        for i, table in tables:
            name = table.get("name", f"{group[:-1]}{i}")
            if isinstance(name, str) and seen.setdefault(name, i) != i:
                found.append(f"{group}[{i}].name = {_shorten(name)}: taken by {group}[{seen[name]}]; names are unique")
            found += _material_problems(_as_table(raw.get("materials")), group, i, table)
            normal = _vector_or_none(table.get("normal"))
            if normal is not None and not _direction(normal, 1 / LARGEST).any():
                found.append(f"{group}[{i}].normal = {_shorten(table['normal'])}: expected a direction, not zero")
    return found


def _tables(raw: dict[str, Any], group: str) -> list[tuple[int, dict]]:
    items = raw.get(group)
    return [(i, item) for i, item in enumerate(items if isinstance(items, list) else []) if isinstance(item, dict)]


def _as_table(value: object) -> dict:
    return value if isinstance(value, dict) else {}


def _material_problems(materials: dict, group: str, i: int, table: dict) -> list[str]:
    name = table.get("material")
    where = f"{group}[{i}].material = {_shorten(name)}"
    if isinstance(name, str) and name not in materials:
        near = _nearest(name, list(materials)) or ("" if materials else "; the file has no materials")
        return [f"{where}: there is no such material{near}"]
    if isinstance(name, str) and group == "spheres" and "checker" in _as_table(materials[name]):
        return [f"{where}: has a checker, which only planes can show"]
    return []


def _camera_problems(camera: dict) -> list[str]:
    position, look_at = (_vector_or_none(camera.get(key)) for key in ("position", "look_at"))
    up = _vector_or_none(camera.get("up", [0, 1, 0]))
    if position is None or look_at is None:
        return []
    if np.array_equal(position.astype(np.float32), look_at.astype(np.float32)):
        return [f"camera.look_at = {_shorten(camera['look_at'])}: expected a point other than camera.position"]
    if up is not None and not _direction(np.cross(_direction(look_at - position), _direction(up)), 1e-6).any():
        return [f"camera.up = {_shorten(camera.get('up', [0, 1, 0]))}: expected a direction not parallel to the view"]
    return []


def _vector_or_none(value: object) -> np.ndarray | None:
    try:
        return np.array(_Vector.model_validate({"value": value}).value)
    except ValidationError:
        return None


class _Vector(_Table):
    value: Vector


def _direction(v: np.ndarray, least: float = 1 / LARGEST) -> np.ndarray:
    """The unit vector, or zero for one that is shorter than the least length."""
    length = np.linalg.norm(v)
    return v / length if length > least else np.zeros(3)


def _dotted(path: tuple[Any, ...]) -> str:
    text = ""
    for part in path:
        plain = isinstance(part, int) or re.fullmatch(r"[\w-]+", part)
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if plain else f".{json.dumps(part)}"
    return text.lstrip(".")


def _shorten(value: object) -> str:
    try:
        text = json.dumps(value, default=str)
    except (ValueError, RecursionError):
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def _nearest(name: str, known: list[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"; did you mean '{near[0]}'?" if near else ""
