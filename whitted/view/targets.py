"""Targets of fits: pictures that a page sends, or that are given by name."""

import tempfile
from pathlib import Path, PurePath

from ..core.arrays import Array
from ..files.images import read_image
from .messages import PIXELS, SIDE

# Bytes of a file that a page may send
LARGEST = 64 << 20


def received(name: str, data: bytes) -> Array:
    """The picture in a file that a page sends; only the ending of its name counts.

    Raises:
        ValueError: not a readable EXR or PNG, or too large; the message begins with the name.
    """
    shown, ending = PurePath(name).name[:80], PurePath(name).suffix.lower()
    if ending not in (".png", ".exr"):
        raise ValueError(f"{shown or 'target'}: expected a picture that ends in .exr or .png")
    with tempfile.TemporaryDirectory(prefix="whitted-") as folder:
        path = Path(folder) / f"target{ending}"
        path.write_bytes(data)
        try:
            image = read_image(path)
        except ValueError as error:
            raise ValueError(str(error).replace(str(path), shown)) from None
    return checked(image, shown)


def checked(image: Array, name: str) -> Array:
    """A target of a size that can be looked at.

    Raises:
        ValueError: it is too large.
    """
    height, width, _ = image.shape
    if width * height > PIXELS or max(width, height) > SIDE:
        raise ValueError(
            f"{name}: {width} x {height} has more than {PIXELS} pixels, or more than {SIDE} along "
            "a side; scale the picture"
        )
    return image
