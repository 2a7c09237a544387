"""Whether files can be written, found out before time goes into their contents."""

import os
from collections.abc import Iterable
from pathlib import Path


def check_file(path: Path) -> None:
    """Refuse a file that could not be written.

    Raises:
        ValueError: there is no folder for it, or one that cannot be written to; or its name is that
            of a folder or of a protected file.
        OSError: the system does not take the name; the error tells why.
    """
    _check_parent(path)
    if not _takes_files(path.parent):
        raise ValueError(f"{path}: the folder '{path.parent}' cannot be written to; choose another")
    _check_name(path)


def check_folder(folder: Path, names: Iterable[str]) -> None:
    """Refuse a folder that could not be made, or in which files could not be written.

    Args:
        folder: it may be missing, but not the folder that it is in.
        names: of the files.

    Raises:
        ValueError, OSError: as `check_file`.
    """
    _check_parent(folder)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder}: is a file; name a folder")
    if not _takes_files(folder if folder.exists() else folder.parent):
        raise ValueError(f"{folder}: cannot be written to; choose another folder")
    if folder.exists():
        for name in names:
            _check_name(folder / name)


def _check_parent(path: Path) -> None:
    if path.parent.exists() and not path.parent.is_dir():
        raise ValueError(f"{path}: '{path.parent}' is a file; name a folder")
    if not path.parent.is_dir():
        raise ValueError(f"{path}: there is no folder '{path.parent}'; make it first")


def _takes_files(folder: Path) -> bool:
    return os.access(folder, os.W_OK | os.X_OK)


def _check_name(path: Path) -> None:
    """Refuse the name of a folder, or of a protected file, which a new file would replace."""
    try:
        path.lstat()
    except FileNotFoundError:
        return
    if path.is_dir():
        raise ValueError(f"{path}: is a folder; name a file")
    if path.exists() and not os.access(path, os.W_OK):
        raise ValueError(f"{path}: is protected from being written; choose another name")
