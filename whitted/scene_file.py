"""Scene files: TOML to a validated `Scene`, with every problem of a file reported at once."""

import difflib
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import drjit as dr
import numpy as np
from drjit.llvm import ad
from pydantic import BaseModel, BeforeValidator, ConfigDict, StrictBool, ValidationError

from .camera import Camera
from .geometry import Plane, Sphere
from .scene import MAX_DEPTH, MAX_OBJECTS, Checker, Material, PointLight, Scene

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

# Squares of all lengths, and their reciprocals, fit single precision
LARGEST = 1e18


class SceneError(ValueError):
    """A scene file that is not valid; the message has a line for each problem."""


def _number(expected: str, accepts: Callable[[float], bool]) -> Any:
    def check(value: object) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LARGEST or not accepts(value):
            raise ValueError(f"expected {expected}")
        return float(value)

    return Annotated[float, BeforeValidator(check)]


def _vector(expected: str, accepts: Callable[[float], bool] = lambda x: True) -> Any:
    def check(value: object) -> list[float]:
        numbers = value if isinstance(value, list) and len(value) == 3 else [None]
        for x in numbers:
            if isinstance(x, bool) or not isinstance(x, (int, float)) or not abs(x) <= LARGEST or not accepts(x):
                raise ValueError(f"expected {expected}")
        return [float(x) for x in numbers]

    return Annotated[list[float], BeforeValidator(check)]


def _integer(expected: str, low: int, high: int) -> Any:
    def check(value: object) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise ValueError(f"expected {expected}")
        return value

    return Annotated[int, BeforeValidator(check)]


def _resolution(value: object) -> tuple[int, ...]:
    if not isinstance(value, list) or len(value) != 2 or not all(type(x) is int and 0 < x <= 1 << 20 for x in value):
        raise ValueError("expected [width, height], two whole numbers of pixels > 0")
    return tuple(value)


def _name(value: object) -> str:
    if not isinstance(value, str) or not value or not value.isprintable():
        raise ValueError("expected a name, a string that is not empty")
    return value


Real = _number("a finite number", lambda x: True)
Positive = _number("a number > 0", lambda x: x >= 1 / LARGEST)
NonNegative = _number("a number >= 0", lambda x: x >= 0)
Weight = _number("a number in [0, 1]", lambda x: 0 <= x <= 1)
Angle = _number("an angle in degrees, in (0, 180)", lambda x: 0 < x < 180)
Vector = _vector("three finite numbers")
Color = _vector("three numbers in [0, 1]", lambda x: 0 <= x <= 1)
Name = Annotated[str, BeforeValidator(_name)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid")


class _Camera(_Table):
    position: Vector
    look_at: Vector
    up: Vector = [0, 1, 0]
    fov: Angle
    resolution: Annotated[tuple[int, int], BeforeValidator(_resolution)]


class _Checker(_Table):
    color: Color
    size: Positive


class _Material(_Table):
    color: Color = [0, 0, 0]
    specular: NonNegative = 0
    shininess: Positive = 50
    reflection: Weight = 0
    refraction: Weight = 0
    ior: Positive = 1.5
    fresnel: StrictBool = False
    checker: _Checker | None = None


class _Sphere(_Table):
    name: Name | None = None
    center: Vector
    radius: Positive
    material: Name


class _Plane(_Table):
    name: Name | None = None
    normal: Vector
    offset: Real
    material: Name


class _Light(_Table):
    name: Name | None = None
    position: Vector
    intensity: Vector
    falloff: Literal["none", "inverse-square"] = "none"


class _Scene(_Table):
    background: Vector = [0, 0, 0]
    ambient: Vector = [0, 0, 0]
    max_depth: _integer(f"a whole number from 1 to {MAX_DEPTH}", 1, MAX_DEPTH) = 5  # type: ignore[valid-type]
    min_importance: Weight = 0
    camera: _Camera
    materials: dict[Name, _Material] = {}
    spheres: list[_Sphere] = []
    planes: list[_Plane] = []
    lights: list[_Light] = []


def load_scene(path: str | Path, precision: str = "single") -> Scene:
    """Read a scene file.

    Args:
        path: a TOML file, as the README describes it.
        precision: "single" (float32) or "double" (float64), of every computation with this scene.

    Raises:
        SceneError: the file cannot be read, or is not a valid scene; the message has a line for each problem.
        ValueError: another precision.
    """
    if precision not in ("single", "double"):
        raise ValueError(f"precision: expected 'single' or 'double', got {precision!r}")
    raw = _parse(Path(path))
    problems = [f"{path}: {problem}" for problem in _problems(raw)]
    if problems:
        raise SceneError("\n".join(problems))
    return _build(_Scene(**raw), precision)


def _parse(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_bytes().decode())
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not a text file in UTF-8: byte {error.start} is not valid") from None
    except tomllib.TOMLDecodeError as error:
        at = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
        where = f":{at[1]}:{at[2]}" if at else ""
        raise SceneError(f"{path}{where}: not valid TOML: {re.sub(r' *[(]at .*[)]$', '', str(error))}") from None
    except (RecursionError, ValueError) as error:
        raise SceneError(f"{path}: not valid TOML: {error}") from None


def _problems(raw: dict[str, Any]) -> list[str]:
    """A line for each problem: dotted path, value, what was expected."""
    problems = []
    try:
        _Scene(**raw)
    except ValidationError as error:
        problems = [_describe(raw, problem) for problem in error.errors(include_url=False)]
    return problems + _cross_problems(raw)


def _describe(raw: dict[str, Any], problem: Any) -> str:
    path, kind = _dotted(problem["loc"]), problem["type"]
    if kind == "extra_forbidden":
        return f"{path}: unknown key{_nearest(str(problem['loc'][-1]), _known_keys(problem['loc'][:-1]))}"
    if kind == "missing":
        return f"{path}: missing; it has no default"
    value = _shorten(problem["input"])
    if kind == "value_error":
        return f"{path} = {value}: {problem['ctx']['error']}"
    if kind == "literal_error":
        near = _nearest(str(problem["input"]), ["none", "inverse-square"])
        return f"{path} = {value}: expected {problem['ctx']['expected']}{near}"
    expected = {"bool_type": "true or false", "list_type": "a list of tables"}.get(kind, "a table")
    return f"{path} = {value}: expected {expected}"


def _known_keys(table: tuple[Any, ...]) -> list[str]:
    """The keys of the table at a path."""
    models = {"camera": _Camera, "spheres": _Sphere, "planes": _Plane, "lights": _Light, "materials": _Material}
    model: Any = models[table[0]] if table else _Scene
    return list(_Checker.model_fields if "checker" in table[2:] else model.model_fields)


def _cross_problems(raw: dict[str, Any]) -> list[str]:
    """What no key alone can tell; tables that are not of the right type were reported already."""
    problems: list[str] = []
    materials = raw.get("materials", {})
    materials = materials if isinstance(materials, dict) else {}
    for group in ("spheres", "planes", "lights"):
        items = raw.get(group, [])
        seen: dict[str, int] = {}
        for i, item in enumerate(items if isinstance(items, list) else []):
            if not isinstance(item, dict):
                continue
            name = item.get("name", f"{group[:-1]}{i}")
            if isinstance(name, str) and seen.setdefault(name, i) != i:
                problems.append(f"{group}[{i}].name = {_shorten(name)}: taken by {group}[{seen[name]}]; names are unique")
            material = item.get("material")
            if isinstance(material, str) and material not in materials:
                near = _nearest(material, list(materials)) or ("" if materials else "; the file has no materials")
                problems.append(f"{group}[{i}].material = {_shorten(material)}: there is no such material{near}")
            elif group == "spheres" and isinstance(material, str) and "checker" in _as_dict(materials[material]):
                problems.append(f"{group}[{i}].material = {_shorten(material)}: has a checker, which only planes can show")
    count = sum(len(raw[group]) for group in ("spheres", "planes", "lights") if isinstance(raw.get(group), list))
    if count > MAX_OBJECTS:
        problems = [f"{count} spheres, planes and lights: expected at most {MAX_OBJECTS}"]
    return problems + _geometry_problems(raw)


def _as_dict(value: object) -> dict:
    return value if isinstance(value, dict) else {}


def _geometry_problems(raw: dict[str, Any]) -> list[str]:
    problems = []
    camera = _as_dict(raw.get("camera"))
    position, look_at, up = (_vector_or_none(camera.get(key, [0, 1, 0])) for key in ("position", "look_at", "up"))
    if position is not None and look_at is not None:
        if np.array_equal(position, look_at):
            problems.append(f"camera.look_at = {_shorten(camera['look_at'])}: expected a point other than camera.position")
        elif up is not None and not _direction(np.cross(_direction(look_at - position), _direction(up))).any():
            problems.append(f"camera.up = {_shorten(camera.get('up', [0, 1, 0]))}: expected a direction not parallel to the view")
    planes = raw.get("planes")
    for i, plane in enumerate(planes if isinstance(planes, list) else []):
        normal = _vector_or_none(_as_dict(plane).get("normal"))
        if normal is not None and not _direction(normal).any():
            problems.append(f"planes[{i}].normal = {_shorten(plane['normal'])}: expected a direction, not zero")
    return problems


def _vector_or_none(value: object) -> np.ndarray | None:
    try:
        return np.array(_Vector(value=value).value)
    except ValidationError:
        return None


class _Vector(_Table):
    value: Vector


def _direction(v: np.ndarray) -> np.ndarray:
    """The unit vector, or zero for one that is too short for single precision to tell from zero."""
    length = np.linalg.norm(v)
    return v / length if length > 1e-6 else np.zeros(3)


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


def _build(data: _Scene, precision: str) -> Scene:
    real, vector = (ad.Float, ad.Array3f) if precision == "single" else (ad.Float64, ad.Array3f64)

    def scalar(x: float) -> Any:
        return dr.opaque(real, x)

    def array(v: Any) -> Any:
        return vector(*(scalar(float(x)) for x in v))

    def material(name: str, m: _Material) -> Material:
        numbers = (scalar(x) for x in (m.specular, m.shininess, m.reflection, m.refraction, m.ior))
        checker = m.checker and Checker(tuple(m.checker.color), m.checker.size)
        return Material(name, array(m.color), *numbers, m.fresnel, checker)

    camera, eye = data.camera, np.array(data.camera.position)
    return Scene(
        camera=Camera(array(camera.position), array(camera.look_at), tuple(camera.up), scalar(camera.fov)),
        resolution=camera.resolution,
        spheres=tuple(
            Sphere(s.name or f"sphere{i}", s.material, array(s.center), scalar(s.radius), precision == "single" and _wide(s, eye))
            for i, s in enumerate(data.spheres)
        ),
        planes=tuple(
            Plane(p.name or f"plane{i}", p.material, array(_unit(p)[:3]), scalar(p.offset)) for i, p in enumerate(data.planes)
        ),
        materials=tuple(material(name, m) for name, m in data.materials.items()),
        lights=tuple(
            PointLight(x.name or f"light{i}", array(x.position), array(x.intensity), x.falloff == "inverse-square")
            for i, x in enumerate(data.lights)
        ),
        background=array(data.background),
        ambient=array(data.ambient),
        max_depth=data.max_depth,
        min_importance=data.min_importance,
        nonzero=_nonzero(data),
        twins=_twins(data),
    )


def _wide(sphere: _Sphere, eye: np.ndarray) -> bool:
    """Whether a camera stands so near to so large a sphere that the squares in its equation cancel."""
    return bool(sphere.radius > 32 * abs(np.linalg.norm(eye - sphere.center) - sphere.radius))


def _unit(plane: _Plane) -> tuple[float, ...]:
    """The unit normal and the offset."""
    normal = np.array(plane.normal)
    return (*(normal / np.linalg.norm(normal)).tolist(), plane.offset)


def _nonzero(data: _Scene) -> tuple[str, ...]:
    weights = ("color", "specular", "reflection", "refraction")
    names = [f"materials.{n}.{field}" for n, m in data.materials.items() for field in weights if np.any(getattr(m, field))]
    return tuple(sorted(names + [name for name in ("background", "ambient") if np.any(getattr(data, name))]))


def _twins(data: _Scene) -> tuple[tuple[int, int], ...]:
    """Pairs of primitives that coincide: a ray that starts on one starts on the other."""
    places: dict[tuple, list[int]] = {}
    for k, sphere in enumerate(data.spheres):
        places.setdefault((*sphere.center, sphere.radius), []).append(k)
    for k, plane in enumerate(data.planes, len(data.spheres)):
        place = _unit(plane)
        places.setdefault(("plane", *max(place, tuple(-x for x in place))), []).append(k)
    return tuple((a, b) for group in places.values() for i, a in enumerate(group) for b in group[i + 1 :])
