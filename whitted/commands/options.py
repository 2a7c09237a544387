"""Options that several commands share, and how their texts are read."""

from pathlib import Path
from typing import Annotated, Literal

import typer


def _scenes(incomplete: str) -> list[str]:
    """What the shell offers for a scene that is being typed: shipped ones, folders and files.

    Where no shipped scene begins like this, shells offer files themselves.
    """
    from ..scene.files import shipped_scenes

    names = [name for name in shipped_scenes() if name.startswith(incomplete)]
    here = [path for path in Path().glob("*") if path.name.startswith(incomplete)]
    files = [path.name for path in here if path.is_dir() or path.suffix == ".toml"]
    shown = [name for name in files if incomplete or not name.startswith(".")]
    return [*names, *sorted(shown)] if names else []


# Pixels along a side
LONGEST = 1 << 20

SceneFile = Annotated[
    Path,
    typer.Argument(
        help="The scene, a TOML file; or the name of a shipped one, as cornell.",
        autocompletion=_scenes,
    ),
]
Spp = Annotated[int, typer.Option(help="Samples per pixel, a perfect square.")]
Depth = Annotated[
    int | None,
    typer.Option(help="Rays on the longest chain, the camera ray included [default: the scene's]."),
]
Size = Annotated[
    str | None,
    typer.Option(metavar="WxH", help="Width and height in pixels [default: the scene's]."),
]
PrecisionName = Annotated[
    Literal["single", "double"], typer.Option(help="Floating-point precision, float32 or float64.")
]
Outputs = Annotated[
    list[Path],
    typer.Option(
        "-o", "--output", metavar="FILE", help="Image to write, .exr or .png; twice for both."
    ),
]
Folder = Annotated[
    Path, typer.Option("-o", "--output", help="Folder for the results; made if it is not there.")
]


def size_of(text: str | None) -> tuple[int, int] | None:
    """The width and height of --size, None where it is not given."""
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    if not all(n.isdecimal() and 1 <= int(n) <= LONGEST for n in (width, height)):
        raise ValueError(f"--size: expected WIDTHxHEIGHT, as in 640x480, got '{text}'")
    return int(width), int(height)


def refuse_together(option: str, others: dict[str, bool]) -> None:
    """Refuse options that are given and that another one chooses itself."""
    given = [name for name, is_given in others.items() if is_given]
    if given:
        names = " and ".join(given)
        raise ValueError(f"{option}: chooses {names} itself; leave {names} out, or {option}")
