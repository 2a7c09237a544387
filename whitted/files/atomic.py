"""Files that are written whole or not at all."""

import errno
import os
import secrets
from collections.abc import Callable
from pathlib import Path


def atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file under a temporary name in the same folder, then rename it.

    Args:
        write: writes the file that it is given.

    Raises:
        OSError: with the name of the file that was asked for; an old one is left as it was.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder; name a file", str(path))
    # The ending stays, as many writers go by it
    name = f".{path.stem}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix.lower()}"
    temporary = path.with_name(name)
    try:
        write(temporary)
        temporary.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, atomically."""
    atomically(path, lambda temporary: _write(temporary, text))


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
