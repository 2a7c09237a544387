"""Image files, EXR or PNG by the suffix.

EXR holds linear radiance as float32 R, G, B. PNG holds 8-bit sRGB (IEC 61966-2-1) of radiance that
is first clipped to [0, 1].
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from drjit.llvm import ad

from . import exr, png
from .atomic import atomically


def write_image(
    path: str | Path, image: object, metadata: Mapping[str, str | int | float] | None = None
) -> None:
    """Write an image, EXR or PNG by the suffix.

    Args:
        path: ends in .exr or .png.
        image: linear RGB of shape (height, width, 3), a Dr.Jit tensor or anything that NumPy
            converts to an array.
        metadata: attributes for the header of an EXR; a PNG has none.

    Raises:
        ValueError: another suffix, or another shape.
        OSError: the file cannot be written; an old one stays as it was.
    """
    path = Path(path)
    pixels = rgb(path, image)
    if _suffix(path) == ".exr":
        atomically(path, lambda temporary: exr.write(temporary, pixels, metadata or {}))
    else:
        atomically(path, lambda temporary: png.write(temporary, pixels))


def read_image(path: str | Path) -> ad.TensorXf:
    """Read an EXR or PNG, by the suffix, as linear RGB.

    Returns:
        A `TensorXf` of shape (height, width, 3).

    Raises:
        ValueError: another suffix, not a readable image of its kind, or not RGB.
        OSError: the file cannot be opened.
    """
    path = Path(path)
    suffix = _suffix(path)
    # A missing file is an OSError here; below it would be reported as a damaged image
    with path.open("rb"):
        pass
    pixels = exr.read(path) if suffix == ".exr" else png.read(path)
    return ad.TensorXf(np.ascontiguousarray(pixels, dtype=np.float32))


def clipped(image: object) -> float:
    """The fraction of an image's pixels with a channel outside [0, 1] or NaN, which PNG clips."""
    pixels = as_numpy(image)
    # Row by row, so that the masks of a large image take little memory
    return float(np.mean([np.mean(~((row >= 0) & (row <= 1)).all(axis=-1)) for row in pixels]))


def rgb(path: Path, image: object) -> np.ndarray:
    """The pixels of an image that is to be written to `path`.

    Raises:
        ValueError: a shape other than (height, width, 3); the message names the path.
    """
    pixels = as_numpy(image)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        raise ValueError(
            f"{path}: expected an image of shape (height, width, 3), got {pixels.shape}"
        )
    return pixels


def as_numpy(image: object) -> np.ndarray:
    """A Dr.Jit tensor, or anything that NumPy converts, as a NumPy array."""
    return np.asarray(image.numpy() if hasattr(image, "numpy") else image)


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in (".exr", ".png"):
        raise ValueError(f"{path}: expected a file name that ends in .exr or .png")
    return suffix
