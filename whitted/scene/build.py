"""From the tables of a file to the fields of a `Scene`."""

import math
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array, Precision
from ..core.host import from_numbers
from ..core.parameter import Parameter, parameters_of, settings_of
from ..lights import LIGHTS
from ..shapes import SHAPES
from .camera import Camera
from .cloud import Cloud
from .material import Material
from .rows import with_files
from .schema import SceneError, default_name, problems
from .surroundings import Surroundings
from .tables import SceneTable
from .texture import Checkerboard


def checked(raw: Any, prefix: str = "", named: bool = False, folder: str = "") -> Any:
    """The validated table of a scene.

    Args:
        raw: the tables of a file.
        folder: what the names of other files are relative to.
        prefix: what each line of a message begins with.
        named: see `problems`.

    Raises:
        SceneError: it is not a valid scene.
    """
    raw, found = with_files(raw, Path(folder))
    found = [f"{prefix}{problem}" for problem in (*found, *problems(raw, named))]
    if found:
        raise SceneError("\n".join(found))
    return SceneTable.model_validate(raw)


def fields_of(table: Any, precision: Precision) -> dict[str, Any]:
    """The fields of the scene of a validated table."""

    def fields(kind: Any, table: Any) -> dict[str, Any]:
        arrays = {
            name: _array(entry, getattr(table, name), precision)
            for name, entry in parameters_of(kind).items()
        }
        return {name: getattr(table, name) for name in settings_of(kind)} | arrays

    def thing(kind: Any, table: Any, **more: Any) -> Any:
        return kind(**fields(kind, table), **more)

    def named(group: str, place: int, table: Any) -> str:
        return table.name or default_name(group, place)

    return {
        **fields(Surroundings, table),
        "camera": thing(Camera, table.camera, up=tuple(table.camera.up)),
        "resolution": table.camera.resolution,
        "shapes": tuple(
            thing(kind, own, name=named(kind.group, i, own), material=own.material)
            for kind in SHAPES
            for i, own in enumerate(getattr(table, kind.group))
        ),
        "clouds": tuple(
            _cloud(own, named("clouds", i, own), precision) for i, own in enumerate(table.clouds)
        ),
        "many": None,
        "materials": tuple(
            thing(
                Material, own, name=name, checker=own.checker and thing(Checkerboard, own.checker)
            )
            for name, own in table.materials.items()
        ),
        "lights": tuple(
            thing(LIGHTS[own.type], own, name=named("lights", i, own))
            for i, own in enumerate(table.lights)
        ),
        "max_depth": table.max_depth,
        "min_importance": table.min_importance,
    }


def _cloud(table: Any, name: str, precision: Precision) -> Cloud:
    numbers = table.spheres.numbers.astype(precision.dtype)
    columns = [from_numbers(column, precision) for column in np.ascontiguousarray(numbers.T)]
    center = precision.vector(*columns[:3])
    return Cloud(name, table.material, center, columns[3], table.spheres.file)


def _array(entry: Parameter, value: Any, precision: Precision) -> Array:
    """A parameter's array, opaque to kernels; a direction has unit length."""
    if entry.size == 1:
        return dr.opaque(precision.real, value)
    if entry.legal.direction:
        length = math.hypot(*value)
        # A unit vector that was rounded stays as it is: what was saved is read back
        if abs(length - 1) > 4 * precision.epsilon:
            value = [x / length for x in value]
    return precision.vector(*(dr.opaque(precision.real, x) for x in value))
