"""Scenes from other renderers."""

import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..mitsuba import xml
from ..mitsuba.reading import read
from .scene import Scene
from .schema import SceneError


def from_mitsuba(
    source: Mapping[str, Any] | str | os.PathLike[str],
    precision: str = "single",
    *,
    approximate: bool = False,
) -> Scene:
    """A scene of Mitsuba 3.

    `whitted.mitsuba` has the table of what is what.

    Args:
        source: a dictionary as `mitsuba.load_dict` takes it, which needs no Mitsuba; or the path of
            an XML file, which Mitsuba reads (`pip install 'whitted[mitsuba]'`). For that a variant
            of Mitsuba must be set; where there is none, it is "scalar_rgb" from then on.
        precision: "single" (float32) or "double" (float64), of every computation with this scene.
        approximate: whether to take what has no exact counterpart here, with a warning for each.

    Returns:
        The scene. A warning says what can make its picture differ from Mitsuba's.

    Raises:
        SceneError: the file cannot be read; or something has no counterpart here. The message has a
            line for each problem, with its path.
        ValueError: another precision.
        RuntimeError: for a path, there is no Mitsuba.
        TypeError: another kind of source.
    """
    where = ""
    if isinstance(source, (str, os.PathLike)):
        where = f"{os.fspath(source)}: "
        try:
            source = xml.load(Path(source))
        except xml.XMLError as error:
            raise SceneError(f"{where}{error}") from None
    if not isinstance(source, Mapping):
        raise TypeError(
            f"source: expected a dictionary of Mitsuba or the path of an XML file, "
            f"got {type(source).__name__}"
        )
    tables, report = read(source, approximate)
    if report.problems:
        raise SceneError("\n".join(f"{where}{problem}" for problem in report.problems))
    scene = Scene._read(tables, precision, prefix=where)
    for warning in report.warnings:
        warnings.warn(f"{where}{warning}", stacklevel=2)
    return scene
