"""Images and derivatives as 8-bit colours, in kernels: NumPy would take longer than rendering."""

from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import ad

from ..core.arrays import Array
from ..core.derivatives import LOCK
from ..core.frozen import frozen
from ..core.power import power
from ..files.false_color import NEGATIVE, POSITIVE
from .marks import EDGE, OUTLINE

# sRGB of the outline of what is picked, and of edges of labels
OUTLINE_COLOR, EDGE_COLOR = (255, 150, 0), (0, 230, 160)
# Under a derivative the picture is grey, between this level and white
DARKEST = 0.5
# Luminance of linear RGB (ITU-R BT.709)
LUMINANCE = (0.2126, 0.7152, 0.0722)


def picture(image: Array, marks: Array | None) -> Any:
    """An image as sRGB.

    Args:
        image: linear RGB, a `TensorXf` or `TensorXf64` of shape (height, width, 3).
        marks: UInt32 for each pixel, from `marks.py`; None for none.

    Returns:
        NumPy's uint8 of shape (height, width, 4): red, green, blue, and 0. Radiance is clipped to
        [0, 1].
    """
    with LOCK:
        return _finished(_picture(image.array, marks, _count(image)), image.shape)


def derivative(slope: Array, scale: float, below: Array | None, marks: Array | None) -> Any:
    """The mean of a derivative's channels, blue below 0, white at 0, red above.

    Args:
        slope: of shape (height, width, 3).
        scale: the value of the strongest colours, > 0.
        below: an image of that shape, to be seen through the colours; None for white.
        marks: as of `picture`.

    Returns:
        NumPy's uint8 of shape (height, width, 4), as of `picture`. NaN is black.
    """
    with LOCK:
        inverse = dr.opaque(dr.value_t(slope.array), 1 / scale)
        below = None if below is None else below.array
        return _finished(
            _derivative(slope.array, inverse, below, marks, _count(slope)), slope.shape
        )


def _count(image: Array) -> int:
    """The number of pixels. Kernels are recorded for each."""
    return int(image.shape[0] * image.shape[1])


def _finished(colors: Array, shape: tuple[int, ...]) -> Any:
    return colors.numpy().view(np.uint8).reshape(*shape[:2], 4)


@frozen
def _picture(pixels: Array, marks: Array | None, count: int) -> Array:
    return _packed([_encoded(channel) for channel in _pixels(pixels, count)], marks)


@frozen
def _derivative(
    pixels: Array, inverse: Array, below: Array | None, marks: Array | None, count: int
) -> Array:
    slope = _pixels(pixels, count)
    t = _clipped(ad.Float((slope[0] + slope[1] + slope[2]) / 3 * inverse), -1)
    grey = ad.Float(1)
    if below is not None:
        color = _pixels(below, count)
        luminance = sum(weight * x for weight, x in zip(LUMINANCE, color, strict=True))
        grey = DARKEST + (1 - DARKEST) / 255 * _encoded(ad.Float(luminance))
    ends = zip(NEGATIVE.tolist(), POSITIVE.tolist(), strict=True)
    colors = [grey * (255 - abs(t) * (255 - dr.select(t < 0, low, high))) for low, high in ends]
    unknown = dr.isnan(slope[0] + slope[1] + slope[2])
    colors = [dr.select(unknown, 0, color) for color in colors]
    return _packed(colors, marks)


def _pixels(pixels: Array, count: int) -> list[Array]:
    """The channels of all pixels."""
    index = dr.arange(ad.UInt32, count)
    return [dr.gather(type(pixels), pixels, 3 * index + k) for k in range(3)]


def _clipped(x: Array, low: float) -> Array:
    """Numbers in [low, 1]; NaN becomes 0. Some LLVM cannot compile what `dr.clip` becomes."""
    x = dr.select(x < low, low, dr.select(x > 1, 1, x))
    return dr.select(dr.isnan(x), 0, x)


def _encoded(linear: Array) -> Array:
    """sRGB (IEC 61966-2-1) of linear values, from 0 to 255."""
    x = _clipped(ad.Float(linear), 0)
    return 255 * dr.select(x <= 0.0031308, 12.92 * x, 1.055 * power(x, ad.Float(1 / 2.4)) - 0.055)


def _packed(colors: list[Array], marks: Array | None) -> Array:
    """The bytes of all pixels, row by row: red, green, blue, and 0, as one word each."""
    word = ad.UInt32(0)
    for k, color in enumerate(colors):
        if marks is not None:
            color = dr.select((marks & EDGE) != 0, EDGE_COLOR[k], color)
            color = dr.select((marks & OUTLINE) != 0, OUTLINE_COLOR[k], color)
        word |= ad.UInt32(color + 0.5) << (8 * k)
    return word
