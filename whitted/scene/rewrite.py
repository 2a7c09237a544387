"""A scene file with other numbers in it: comments, names and order stay as they are."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

GROUPS = ("spheres", "planes", "lights")


def rewritten(path: str | Path, parameters: Mapping[str, Any]) -> str:
    """The text of a scene file with new values of parameters.

    Args:
        path: a valid scene file.
        parameters: name, as in `Scene.parameters`, to a number or three; nine digits of each are written.

    Raises:
        RuntimeError: there is no tomlkit.
        OSError: the file cannot be read.
    """
    try:
        import tomlkit
    except ImportError:
        raise RuntimeError(
            "scenes are written by tomlkit, which is missing; install it with: pip install 'whitted[fit]'"
        ) from None
    document: Any = tomlkit.parse(Path(path).read_bytes().decode())
    for name, value in parameters.items():
        kind, _, rest = name.partition(".")
        owner, _, field = rest.rpartition(".")
        table = _table(document, kind, owner)
        numbers = [float(f"{number:.9g}") for number in np.ravel(value)]
        table[field or kind] = numbers if len(numbers) > 1 else numbers[0]
    return tomlkit.dumps(document)


def _table(document: Any, kind: str, owner: str) -> Any:
    """The table of the file that has a parameter."""
    if kind in GROUPS:
        named = [item.get("name", f"{kind[:-1]}{k}") for k, item in enumerate(document[kind])]
        return document[kind][named.index(owner)]
    if kind == "materials":
        return document[kind][owner]
    return document[kind] if kind == "camera" else document
