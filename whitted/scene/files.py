"""Scenes from files, from text, and those that come with the package."""

import difflib
from pathlib import Path

from ..core.arrays import precision_named
from .scene import Scene
from .schema import SceneError
from .toml import tables_in

__all__ = ["SceneError", "load_scene", "parse_scene"]

# Of an installed package, and of a checkout
SHIPPED = Path(__file__).parents[1] / "scenes", Path(__file__).parents[2] / "scenes"


def load_scene(path: str | Path, precision: str = "single") -> Scene:
    """Read a scene file.

    Args:
        path: a TOML file; or the name of a scene that comes with the package, such as "cornell".
        precision: "single" (float32) or "double" (float64), of every computation with this scene.

    Raises:
        SceneError: the file cannot be read, or is not a valid scene; the message has a line for
            each problem.
        ValueError: another precision.
    """
    precision_named(precision)
    path = _found(Path(path))
    try:
        text = path.read_bytes().decode()
    except OSError as error:
        shipped = path.suffix == ".toml" and path.stem in shipped_scenes()
        hint = f"; the shipped scene is called '{path.stem}'" if shipped else ""
        raise SceneError(f"{path}: cannot be read: {error.strerror}{hint}") from None
    except UnicodeDecodeError as error:
        raise SceneError(
            f"{path}: not a text file in UTF-8: byte {error.start} is not valid"
        ) from None
    tables, folder = tables_in(text, str(path)), str(path.parent)
    return Scene._read(tables, precision, prefix=f"{path}: ", text=text, folder=folder)


def parse_scene(text: str, precision: str = "single") -> Scene:
    """Make a scene of the text of a scene file; files that it names are in the current folder.

    Raises:
        SceneError: it is not a valid scene; the message has a line for each problem.
        ValueError: another precision.
        TypeError: bytes, or a file.
    """
    if not isinstance(text, str):
        raise TypeError(
            f"text: expected a string, got a {type(text).__name__}; load_scene reads a file"
        )
    return Scene._read(tables_in(text), precision, text=text)


def shipped_scenes() -> dict[str, Path]:
    """The files of the scenes that come with the package, by their names."""
    return {each.stem: each for folder in SHIPPED for each in sorted(folder.glob("*.toml"))}


def _found(path: Path) -> Path:
    """The file of a shipped scene, where a bare name is given; else the path itself."""
    if path.suffix or path.name != str(path) or path.is_file():
        return path
    shipped = shipped_scenes()
    if path.name in shipped:
        return shipped[path.name]
    near = difflib.get_close_matches(path.name, shipped, n=3, cutoff=0.5) or list(shipped)
    raise SceneError(
        f"{path}: there is no such file, and no shipped scene of this name; "
        f"nearest: {', '.join(near)}"
    )
