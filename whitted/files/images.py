"""Images as files: EXR and PNG, by the ending; knows nothing of scenes.

EXR holds linear radiance as float32 R, G, B. PNG holds sRGB in 8 bits: radiance is clipped to [0,
1] first, and encoded by IEC 61966-2-1.
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
    """Write an image, EXR or PNG by the ending.

    Args:
        path: ends in .exr or .png.
        image: linear RGB of shape (height, width, 3), a Dr.Jit tensor or what NumPy takes for an
            array.
        metadata: header attributes of an EXR; a PNG has none.

    Raises:
        ValueError: another ending, or another shape.
        OSError: the file cannot be written; an old one is left as it was.
    """
    path = Path(path)
    pixels = rgb(path, image)
    if _ending(path) == ".exr":
        atomically(path, lambda temporary: exr.write(temporary, pixels, metadata or {}))
    else:
        atomically(path, lambda temporary: png.write(temporary, pixels))


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
    pixels = exr.read(path) if ending == ".exr" else png.read(path)
    return ad.TensorXf(np.ascontiguousarray(pixels, dtype=np.float32))


def clipped(image: object) -> float:
    """The fraction of an image's pixels that a PNG cannot hold: a channel is above 1, below 0, or
    not a number.
    """
    pixels = as_numpy(image)
    return float(np.mean([np.mean(~((row >= 0) & (row <= 1)).all(axis=-1)) for row in pixels]))


def rgb(path: Path, image: object) -> np.ndarray:
    """The pixels of an image to be written, which must be of shape (height, width, 3)."""
    pixels = as_numpy(image)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        raise ValueError(
            f"{path}: expected an image of shape (height, width, 3), got {pixels.shape}"
        )
    return pixels


def as_numpy(image: object) -> np.ndarray:
    """An image, a Dr.Jit tensor or what NumPy takes for an array, as an array of NumPy's."""
    return np.asarray(image.numpy() if hasattr(image, "numpy") else image)


def _ending(path: Path) -> str:
    ending = path.suffix.lower()
    if ending not in (".exr", ".png"):
        raise ValueError(f"{path}: expected a file name that ends in .exr or .png")
    return ending
