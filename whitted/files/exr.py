"""Writing OpenEXR files: float32 R, G, B in ZIP-compressed scanlines."""

import contextlib
import errno
import mmap
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

# Rows in a chunk under ZIP compression, by the OpenEXR format
CHUNK_ROWS = 16


def write(path: Path, pixels: np.ndarray, metadata: Mapping[str, str | int | float]) -> None:
    """Write a new EXR.

    Args:
        path: the file, which must not exist.
        pixels: linear RGB of shape (height, width, 3); stored as float32.
        metadata: further attributes of the header.

    Raises:
        OSError: the file cannot be written.
    """
    import OpenEXR

    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION, **metadata}
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    # OpenEXR does not say why it cannot open a file; this does
    path.touch(exist_ok=False)
    try:
        with OpenEXR.File(header, {"RGB": pixels}) as file:
            file.write(str(path))
        complete = _is_complete(path, chunks=-(-len(pixels) // CHUNK_ROWS))
    except RuntimeError:
        complete = False
    if not complete:
        raise OSError(errno.EIO, "cannot be written; is the disk full?", str(path))


def _is_complete(path: Path, chunks: int) -> bool:
    """Whether an EXR ends where its last chunk does.

    OpenEXR reports no error when the last buffer of a file cannot be written.
    """
    with path.open("rb") as file, contextlib.suppress(ValueError):
        if not os.fstat(file.fileno()).st_size:
            return False
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            # The last entry of the table of chunk offsets, 8 bytes each, which follows the header
            entry = _header_end(data) + 8 * (chunks - 1)
            chunk = _integer(data, entry, 8)
            # A chunk: its first row and its size, 4 bytes each, then its data
            return chunk > entry and len(data) == chunk + 8 + _integer(data, chunk + 4, 4)
    return False


def _header_end(data: mmap.mmap) -> int:
    """The offset of the first byte after the header.

    Raises:
        ValueError: the header has no end.
    """
    # After 8 bytes of magic number and version, each attribute is a name and a type, both ended
    # by a zero byte, a length of 4 bytes, and as many bytes; a zero byte ends the header
    offset = 8
    while data[offset : offset + 1] not in (b"\0", b""):
        length = _after_zero(data, _after_zero(data, offset))
        offset = length + 4 + _integer(data, length, 4)
    return offset + 1


def _integer(data: mmap.mmap, offset: int, size: int) -> int:
    return int.from_bytes(data[offset : offset + size], "little")


def _after_zero(data: mmap.mmap, offset: int) -> int:
    """The offset behind the next zero byte."""
    found = data.find(b"\0", offset)
    if found < 0:
        raise ValueError("the file ends in its header")
    return found + 1
