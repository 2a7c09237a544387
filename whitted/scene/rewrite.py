"""A scene file with other numbers in it: comments, names and order stay as they are."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .files import load_scene
from .parameters import Location, check_names
from .scene import Scene


def rewritten(path: str | Path, parameters: Mapping[str, Any]) -> str:
    """The text of a scene file with new values of parameters.

    Args:
        path: a valid scene file.
        parameters: name, as in `Scene.parameters`, to a number or three; nine digits of each are
            written.

    Raises:
        RuntimeError: there is no tomlkit.
        SceneError: the file cannot be read, or is not a valid scene.
        KeyError: a name that the scene does not have; the message lists the nearest ones.
    """
    try:
        import tomlkit
    except ImportError:
        raise RuntimeError(
            "scenes are written by tomlkit, which is missing; "
            "install it with: pip install 'whitted[fit]'"
        ) from None
    scene = load_scene(path)
    check_names(parameters, scene.locations)
    document: Any = tomlkit.parse(Path(path).read_bytes().decode().removeprefix("\ufeff"))
    for name, value in parameters.items():
        where = scene.locations[name]
        numbers = [float(f"{number:.9g}") for number in np.ravel(value)]
        key = where.path[-1] if where.path else where.field
        _table(document, scene, where)[key] = numbers if len(numbers) > 1 else numbers[0]
    return tomlkit.dumps(document)


def _table(document: Any, scene: Scene, where: Location) -> Any:
    """The table of the file that has a parameter."""
    if where.place is None:
        return document[where.field] if where.path else document
    if where.field == "shapes":
        kind = type(scene.shapes[where.place])
        before = sum(type(shape) is kind for shape in scene.shapes[: where.place])
        table = document[kind.group][before]
    elif where.field == "materials":
        table = document["materials"][scene.materials[where.place].name]
    else:
        table = document[where.field][where.place]
    for part in where.path[:-1]:
        table = table[part]
    return table
