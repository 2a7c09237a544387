"""Scene files: TOML to a validated `Scene`, with every problem of a file reported at once."""

import re
import sys
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import ad

from .camera import Camera
from .geometry import Plane, Sphere
from .scene import Checker, Material, PointLight, Scene
from .schema import MaterialTable, PlaneTable, SceneTable, SphereTable, problems

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


class SceneError(ValueError):
    """A scene file that is not valid; the message has a line for each problem."""


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
    found = [f"{path}: {problem}" for problem in problems(raw)]
    if found:
        raise SceneError("\n".join(found))
    return _build(SceneTable.model_validate(raw), precision)


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


def _build(data: SceneTable, precision: str) -> Scene:
    real, vector = (ad.Float, ad.Array3f) if precision == "single" else (ad.Float64, ad.Array3f64)

    def scalar(x: float) -> Any:
        return dr.opaque(real, x)

    def array(v: Any) -> Any:
        return vector(*(scalar(float(x)) for x in v))

    def material(name: str, m: MaterialTable) -> Material:
        checker = Checker(_triple(m.checker.color), m.checker.size) if m.checker else None
        return Material(
            name=name,
            color=array(m.color),
            specular=scalar(m.specular),
            shininess=scalar(m.shininess),
            reflection=scalar(m.reflection),
            refraction=scalar(m.refraction),
            ior=scalar(m.ior),
            fresnel=m.fresnel,
            checker=checker,
        )

    camera, eye = data.camera, np.array(data.camera.position)
    return Scene(
        camera=Camera(array(camera.position), array(camera.look_at), _triple(camera.up), scalar(camera.fov)),
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


def _triple(v: list[float]) -> tuple[float, float, float]:
    return v[0], v[1], v[2]


def _wide(sphere: SphereTable, eye: np.ndarray) -> bool:
    """Whether a camera stands so near to so large a sphere that the squares in its equation cancel."""
    return bool(sphere.radius > 32 * abs(np.linalg.norm(eye - sphere.center) - sphere.radius))


def _unit(plane: PlaneTable) -> tuple[float, ...]:
    """The unit normal and the offset."""
    normal = np.array(plane.normal)
    return (*(normal / np.linalg.norm(normal)).tolist(), plane.offset)


def _nonzero(data: SceneTable) -> tuple[str, ...]:
    weights = ("color", "specular", "reflection", "refraction")
    names = [f"materials.{n}.{field}" for n, m in data.materials.items() for field in weights if np.any(getattr(m, field))]
    return tuple(sorted(names + [name for name in ("background", "ambient") if np.any(getattr(data, name))]))


def _twins(data: SceneTable) -> tuple[tuple[int, int], ...]:
    """Pairs of primitives that coincide: a ray that starts on one starts on the other."""
    places: dict[tuple, list[int]] = {}
    for k, sphere in enumerate(data.spheres):
        places.setdefault((*sphere.center, sphere.radius), []).append(k)
    for k, plane in enumerate(data.planes, len(data.spheres)):
        place = _unit(plane)
        places.setdefault(("plane", *max(place, tuple(-x for x in place))), []).append(k)
    return tuple((a, b) for group in places.values() for i, a in enumerate(group) for b in group[i + 1 :])
