"""Image files: EXR and PNG, written whole or not at all; knows nothing of scenes.

EXR holds linear radiance as float32 R, G, B in ZIP-compressed scanlines. PNG holds sRGB in 8 bits: radiance is clipped
to [0, 1] first, and encoded by IEC 61966-2-1.
"""

import contextlib
import errno
import mmap
import os
import secrets
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from drjit.llvm import ad


def write_image(path: str | Path, image: object, metadata: Mapping[str, str | int | float] | None = None) -> None:
    """Write an image, EXR or PNG by the ending.

    Args:
        path: ends in .exr or .png.
        image: linear RGB of shape (height, width, 3), a Dr.Jit tensor or what NumPy takes for an array.
        metadata: header attributes of an EXR; a PNG has none.

    Raises:
        ValueError: another ending, or another shape.
        OSError: the file cannot be written; an old one is left as it was.
    """
    path = Path(path)
    pixels = rgb(path, image)
    if _ending(path) == ".exr":
        atomically(path, lambda temporary: _write_exr(temporary, pixels, metadata or {}))
    else:
        atomically(path, lambda temporary: _write_png(temporary, pixels))


def read_image(path: str | Path) -> ad.TensorXf:
    """Read an EXR or PNG, by the ending, as linear RGB.

    Returns:
        A `TensorXf` of shape (height, width, 3).

    Raises:
        ValueError: another ending, not a readable image of its kind, or not RGB.
        OSError: the file cannot be opened.
    """
    path = Path(path)
    ending = _ending(path)
    with path.open("rb"):
        pass  # a missing file or a folder is the caller's OSError, not a broken image
    pixels = _read_exr(path) if ending == ".exr" else _read_png(path)
    return ad.TensorXf(np.ascontiguousarray(pixels, dtype=np.float32))


def to_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear values, clipped to [0, 1], as sRGB in [0, 1]."""
    x = np.clip(np.nan_to_num(linear, nan=0.0), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def from_srgb(encoded: np.ndarray) -> np.ndarray:
    """sRGB in [0, 1] as linear values."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def clipped(image: object) -> float:
    """The fraction of an image's pixels that a PNG cannot hold: some channel is above 1, below 0, or not a number."""
    pixels = _pixels(image)
    return float(np.mean([np.mean(~((row >= 0) & (row <= 1)).all(axis=-1)) for row in pixels]))


def rgb(path: Path, image: object) -> np.ndarray:
    """The pixels of an image to be written, which must be of shape (height, width, 3)."""
    pixels = _pixels(image)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        raise ValueError(f"{path}: expected an image of shape (height, width, 3), got {pixels.shape}")
    return pixels


def _pixels(image: object) -> np.ndarray:
    return np.asarray(image.numpy() if hasattr(image, "numpy") else image)


def _ending(path: Path) -> str:
    ending = path.suffix.lower()
    if ending not in (".exr", ".png"):
        raise ValueError(f"{path}: expected a file name that ends in .exr or .png")
    return ending


def atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Write to a temporary file beside the path, of the same ending, then rename it."""
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder; name a file", str(path))
    temporary = path.with_name(f".{path.stem}-{os.getpid()}-{secrets.token_hex(4)}{path.suffix.lower()}")
    try:
        write(temporary)
        temporary.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)


def _write_exr(path: Path, pixels: np.ndarray, metadata: Mapping[str, str | int | float]) -> None:
    import OpenEXR

    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION, **metadata}
    pixels = np.ascontiguousarray(pixels, dtype=np.float32)
    path.touch(exist_ok=False)  # OpenEXR does not say why it could not
    try:
        with OpenEXR.File(header, {"RGB": pixels}) as file:
            file.write(str(path))
        whole = _ends_with_its_last_chunk(path, -(-len(pixels) // 16))
    except RuntimeError:
        whole = False
    if not whole:
        raise OSError(errno.EIO, "cannot be written; is the disk full?", str(path))


def _ends_with_its_last_chunk(path: Path, chunks: int) -> bool:
    """Whether an EXR is whole, as OpenEXR is silent where the last buffer of its stream could not be written."""
    with path.open("rb") as file, contextlib.suppress(ValueError):
        if not os.fstat(file.fileno()).st_size:
            return False
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            # Each attribute of the header is a name, a type, a length and as many bytes; then offsets of the chunks
            place = 8
            while data[place : place + 1] not in (b"\0", b""):
                value = _after_zero(data, _after_zero(data, place))
                place = value + 4 + int.from_bytes(data[value : value + 4], "little")
            last = place + 1 + 8 * (chunks - 1)
            chunk = int.from_bytes(data[last : last + 8], "little")
            return len(data) == chunk + 8 + int.from_bytes(data[chunk + 4 : chunk + 8], "little") and chunk > last
    return False


def _after_zero(data: mmap.mmap, place: int) -> int:
    """The place behind the next zero byte."""
    found = data.find(b"\0", place)
    if found < 0:
        raise ValueError("the file ends in its header")
    return found + 1


def _write_png(path: Path, pixels: np.ndarray) -> None:
    from PIL import Image

    # A row at a time keeps the double precision of the encoding out of memory
    encoded = np.empty(pixels.shape, dtype=np.uint8)
    for row, out in zip(pixels, encoded, strict=True):
        out[:] = to_srgb(row) * 255 + 0.5
    Image.fromarray(encoded).save(path)


def _read_exr(path: Path) -> np.ndarray:
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


def _read_png(path: Path) -> np.ndarray:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path, formats=["PNG"]) as image:
            mode = image.mode
            pixels = np.asarray(image)
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"{path}: not a readable PNG: {error}") from None
    if mode not in ("RGB", "RGBA"):
        raise ValueError(f"{path}: not an RGB image; its mode is {mode}")
    return from_srgb(pixels[..., :3] / 255)
