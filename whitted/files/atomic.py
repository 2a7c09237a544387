"""Files that are written whole or not at all."""

import errno
import os
import secrets
from collections.abc import Callable
from pathlib import Path


def atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Write a file under a temporary name in the same folder, then rename it.

    Args:
        path: the file; an old one is replaced only if all goes well.
        write: a function that writes the file whose path it is given.

    Raises:
        OSError: the file cannot be written; the error names `path`.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder; name a file", str(path))
    if path.exists() and not os.access(path, os.W_OK):
        # To rename another file to its name would succeed
        message = "is protected from being written; choose another name"
        raise PermissionError(errno.EACCES, message, str(path))
    # Keep the suffix: Pillow and matplotlib choose the format by it. A name has at most 255 bytes
    name = f".{path.stem[:20]}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix.lower()}"
    temporary = path.with_name(name)
    try:
        write(temporary)
        temporary.replace(path)
    except ConnectionError:
        # It is not the file's
        raise
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file, atomically."""

    def write(temporary: Path) -> None:
        temporary.write_bytes(content)

    atomically(path, write)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, atomically."""

    def write(temporary: Path) -> None:
        temporary.write_text(text, encoding="utf-8")

    atomically(path, write)
