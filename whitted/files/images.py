"""Image files, EXR or PNG by the suffix.

EXR holds linear radiance as float32 R, G, B. PNG holds 8-bit sRGB (IEC 61966-2-1) of radiance that
is first clipped to [0, 1]. What other programs write into such files is read as well.
"""

import os
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from drjit.llvm import ad

from ..core.host import to_array
from . import exr, exr_reading, png
from .atomic import atomically
from .writable import check_file


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
        ValueError: another suffix, or another shape; or integers, which are no radiance.
        TypeError: what is given first is no path.
        OSError: the file cannot be written; an old one stays as it was.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise TypeError(
            f"path: expected the name of a file, got a {type(path).__name__}; "
            "as in write_image('a.png', image)"
        )
    path = Path(path)
    pixels, suffix = rgb(path, image), _suffix(path)
    if suffix == ".exr":
        atomically(path, lambda temporary: exr.write(temporary, pixels, metadata or {}))
    else:
        atomically(path, lambda temporary: png.write(temporary, pixels))


def read_image(path: str | Path, layer: str | None = None) -> ad.TensorXf:
    """Read an EXR or PNG, by the suffix, as linear RGB.

    Alpha is ignored: radiance in an EXR has it multiplied in already, and pixels of a PNG are taken
    as if they were opaque. Grey is the same in all three channels. An EXR's pixels are placed in
    its display window, with black around them. A PNG is sRGB, unless its gamma (`gAMA`) says
    otherwise.

    Args:
        path: ends in .exr or .png.
        layer: of an EXR, a layer, as in "Render.Main" for the channel "Render.Main.R"; or a part,
            or both, as in "part.layer" [default: the plain channels of the first part with a
            picture, or its only layer].

    Returns:
        A `TensorXf` of shape (height, width, 3).

    Raises:
        ValueError: another suffix, not a readable image of its kind, or no such layer; the message
            says what is there.
        OSError: the file cannot be opened.
    """
    path = Path(path)
    suffix = _suffix(path)
    if layer is not None and suffix == ".png":
        raise ValueError(f"{path}: a PNG has no layers; leave layer='{layer}' out")
    # A missing file is an OSError here; below it would be reported as a damaged image
    with path.open("rb"):
        pass
    pixels = exr_reading.read(path, layer) if suffix == ".exr" else png.read(path)
    flat = np.asarray(pixels, np.float32).ravel()
    return ad.TensorXf(to_array(flat, flat.size), pixels.shape)


def check_image(path: Path) -> None:
    """Refuse an image file that could not be written, before time goes into the image.

    Raises:
        ValueError: the name or the folder will not do.
    """
    _suffix(path)
    check_file(path)


def clipped(image: object) -> float:
    """The fraction of an image's pixels with a channel outside [0, 1] or NaN, which PNG clips."""
    pixels = as_numpy(image)
    # Row by row, so that the masks of a large image take little memory
    return float(np.mean([np.mean(~((row >= 0) & (row <= 1)).all(axis=-1)) for row in pixels]))


def rgb(path: Path, image: object) -> np.ndarray:
    """The pixels of an image that is to be written to `path`.

    Raises:
        ValueError: integers, or a shape other than (height, width, 3); the message names the path.
    """
    pixels = radiance(image, str(path))
    if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        raise ValueError(
            f"{path}: expected an image of shape (height, width, 3), got {pixels.shape}"
        )
    return pixels


def radiance(image: object, where: str) -> np.ndarray:
    """An image that a user gives, as a NumPy array of real numbers.

    Args:
        where: what messages begin with.

    Raises:
        ValueError: it is not an array of real numbers. Integers are refused, too: they are mostly
            an 8-bit picture, 255 times as bright, and not linear.
    """
    pixels = numbers(image, where)
    if pixels.dtype.kind == "b":
        raise ValueError(
            f"{where}: truth values are no radiance; convert them to float if 0 and 1 are meant"
        )
    if pixels.dtype.kind in "iu":
        whole = 65535 if pixels.dtype == np.uint16 else 255
        raise ValueError(
            f"{where}: integers ({pixels.dtype}) are no radiance; divide by {whole} and make them "
            "linear, as read_image does with a file, or convert radiance to float"
        )
    return pixels


def numbers(image: object, where: str) -> np.ndarray:
    """A Dr.Jit tensor, or what NumPy takes for an array, as an array of numbers or truth values.

    Raises:
        ValueError: it is something else.
    """
    try:
        array = as_numpy(image)
    except (TypeError, ValueError):
        array = np.array(None)
    if array.dtype.kind not in "biuf":
        remedy = "; read a file by read_image" if isinstance(image, (str, Path)) else ""
        raise ValueError(
            f"{where}: expected an array of numbers, got {type(image).__name__}{remedy}"
        )
    return array


def as_numpy(image: object) -> np.ndarray:
    """A Dr.Jit tensor, or anything that NumPy converts, as a NumPy array."""
    return np.asarray(image.numpy() if hasattr(image, "numpy") else image)


def _suffix(path: Path) -> str:
    """The suffix of an image file whose name will do.

    Raises:
        ValueError: another suffix, or a name that OpenEXR does not take.
    """
    suffix = path.suffix.lower()
    if suffix not in (".exr", ".png"):
        raise ValueError(f"{path}: expected a file name that ends in .exr or .png")
    # Python keeps bytes that are not UTF-8 as halves of surrogate pairs
    if suffix == ".exr" and re.search("[\ud800-\udfff]", str(path)):
        raise ValueError(
            f"{str(path)!a}: OpenEXR takes only names in UTF-8; rename the file or its folder"
        )
    return suffix
