"""Scene files: TOML to a validated `Scene`, with every problem of a file reported at once."""

import re
import sys
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import PRECISIONS, Array, Precision
from ..core.parameter import Parameter, parameters_of, settings_of
from ..lights import LIGHTS
from ..shapes import SHAPES
from .camera import Camera
from .material import Material
from .scene import Scene
from .schema import default_name, problems
from .tables import SceneTable
from .texture import Checkerboard

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


class SceneError(ValueError):
    """A scene file that is not valid; the message has a line for each problem."""


def load_scene(path: str | Path, precision: str = "single") -> Scene:
    """Read a scene file.

    Args:
        path: a TOML file.
        precision: "single" (float32) or "double" (float64), of every computation with this scene.

    Raises:
        SceneError: the file cannot be read, or is not a valid scene; the message has a line for
            each problem.
        ValueError: another precision.
    """
    named = {each.name: each for each in PRECISIONS}
    if precision not in named:
        raise ValueError(f"precision: expected 'single' or 'double', got {precision!r}")
    raw = _parse(Path(path))
    found = [f"{path}: {problem}" for problem in problems(raw)]
    if found:
        raise SceneError("\n".join(found))
    scene = _scene(SceneTable.model_validate(raw), named[precision])
    # Read the numbers now: within a function that the user freezes they cannot be read
    _ = scene.numbers
    return scene


def _parse(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_bytes().decode().removeprefix("\ufeff"))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise SceneError(
            f"{path}: not a text file in UTF-8: byte {error.start} is not valid"
        ) from None
    except tomllib.TOMLDecodeError as error:
        at = re.search(r"\(at line (\d+), column (\d+)\)", str(error))
        where = f":{at[1]}:{at[2]}" if at else ""
        raise SceneError(
            f"{path}{where}: not valid TOML: {re.sub(r' *[(]at .*[)]$', '', str(error))}"
        ) from None
    except (RecursionError, ValueError) as error:
        raise SceneError(f"{path}: not valid TOML: {error}") from None


def _scene(table: Any, precision: Precision) -> Scene:
    """The scene of a validated table."""

    def thing(kind: Any, table: Any, **more: Any) -> Any:
        arrays = {
            name: _array(entry, getattr(table, name), precision)
            for name, entry in parameters_of(kind).items()
        }
        return kind(**{name: getattr(table, name) for name in settings_of(kind)}, **arrays, **more)

    def named(group: str, place: int, table: Any) -> str:
        return table.name or default_name(group, place)

    return thing(
        Scene,
        table,
        camera=thing(Camera, table.camera, up=tuple(table.camera.up)),
        resolution=table.camera.resolution,
        shapes=tuple(
            thing(kind, own, name=named(kind.group, i, own), material=own.material)
            for kind in SHAPES
            for i, own in enumerate(getattr(table, kind.group))
        ),
        materials=tuple(
            thing(
                Material, own, name=name, checker=own.checker and thing(Checkerboard, own.checker)
            )
            for name, own in table.materials.items()
        ),
        lights=tuple(
            thing(LIGHTS[own.type], own, name=named("lights", i, own))
            for i, own in enumerate(table.lights)
        ),
        max_depth=table.max_depth,
        min_importance=table.min_importance,
    )


def _array(entry: Parameter, value: Any, precision: Precision) -> Array:
    """A parameter's array, opaque to kernels; a direction has unit length."""
    if entry.size == 1:
        return dr.opaque(precision.real, value)
    if entry.legal.direction:
        value = (np.array(value) / np.linalg.norm(value)).tolist()
    return precision.vector(*(dr.opaque(precision.real, x) for x in value))
