"""Saving by name, into one folder."""

import re
from collections.abc import Callable
from pathlib import Path

ENDINGS = (".toml", ".png", ".exr")
# Letters, digits, and a few signs: no name leads to another folder, or hides itself
NAME = re.compile(r"[\w][\w .+-]{0,99}")


class FileIsThereError(ValueError):
    """A file has the name already; to write over it has to be asked for."""


def path_of(folder: Path, name: str, replace: bool) -> Path:
    """The file of a name that a page gives.

    Raises:
        ValueError: another ending, or a name that is not one of a file in the folder.
        FileIsThereError: the file is there, and is not to be replaced.
    """
    if not NAME.fullmatch(name) or name != name.strip():
        raise ValueError(
            f"save: {name!r} is not a plain name; use letters, digits, spaces and . _ + -"
        )
    path = folder / name
    if path.suffix.lower() not in ENDINGS:
        raise ValueError(f"save: '{name}' should end in .toml (the scene), .png or .exr")
    if path.is_symlink() or path.is_dir():
        raise ValueError(f"save: '{name}' is a link or a folder; choose another name")
    if path.exists() and not replace:
        raise FileIsThereError(f"save: '{name}' is there already; save again to replace it")
    return path


def written(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file, and tell in one line why that fails.

    Raises:
        ValueError: the system does not take the file.
    """
    try:
        write(path)
    except OSError as error:
        raise ValueError(f"save: '{path.name}' cannot be written: {error.strerror}") from None
