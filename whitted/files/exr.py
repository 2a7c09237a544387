"""OpenEXR files: float32 R, G, B in ZIP-compressed scanlines."""

import contextlib
import errno
import mmap
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

# Rows of a ZIP-compressed chunk
CHUNK_ROWS = 16


def write(path: Path, pixels: np.ndarray, metadata: Mapping[str, str | int | float]) -> None:
    import OpenEXR

    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION, **metadata}
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    path.touch(exist_ok=False)  # OpenEXR does not say why it could not
    try:
        with OpenEXR.File(header, {"RGB": pixels}) as file:
            file.write(str(path))
        whole = _ends_with_its_last_chunk(path, -(-len(pixels) // CHUNK_ROWS))
    except RuntimeError:
        whole = False
    if not whole:
        raise OSError(errno.EIO, "cannot be written; is the disk full?", str(path))


def _ends_with_its_last_chunk(path: Path, chunks: int) -> bool:
    """Whether an EXR is whole, as OpenEXR is silent where the last buffer of its stream could not
    be written.
    """
    with path.open("rb") as file, contextlib.suppress(ValueError):
        if not os.fstat(file.fileno()).st_size:
            return False
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            # Each attribute of the header is a name, a type, a length and as many bytes; then
            # offsets of the chunks
            place = 8
            while data[place : place + 1] not in (b"\0", b""):
                value = _after_zero(data, _after_zero(data, place))
                place = value + 4 + int.from_bytes(data[value : value + 4], "little")
            last = place + 1 + 8 * (chunks - 1)
            chunk = int.from_bytes(data[last : last + 8], "little")
            return (
                len(data) == chunk + 8 + int.from_bytes(data[chunk + 4 : chunk + 8], "little")
                and chunk > last
            )
    return False


def _after_zero(data: mmap.mmap, place: int) -> int:
    """The place behind the next zero byte."""
    found = data.find(b"\0", place)
    if found < 0:
        raise ValueError("the file ends in its header")
    return found + 1


def read(path: Path) -> np.ndarray:
    import OpenEXR

    try:
        with OpenEXR.File(str(path)) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, TypeError, ValueError, MemoryError):
        raise ValueError(f"{path}: not an EXR, or damaged") from None
    for name in ("RGB", "RGBA"):
        if name in channels:
            return channels[name][..., :3]
    raise ValueError(f"{path}: not an RGB image; its channels are {', '.join(channels) or 'none'}")
