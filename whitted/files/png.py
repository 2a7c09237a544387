"""PNG files: sRGB in 8 bits (IEC 61966-2-1)."""

from pathlib import Path

import numpy as np


def to_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear values, clipped to [0, 1], as sRGB in [0, 1]; NaN becomes 0."""
    x = np.clip(np.nan_to_num(linear, nan=0.0), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def from_srgb(encoded: np.ndarray) -> np.ndarray:
    """sRGB in [0, 1] as linear values in [0, 1]."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def write(path: Path, pixels: np.ndarray) -> None:
    """Write a PNG from linear RGB of shape (height, width, 3), clipped to [0, 1].

    Raises:
        OSError: the file cannot be written.
    """
    from PIL import Image

    # Encode row by row: the double-precision intermediates of a large image take much memory
    encoded = np.empty(pixels.shape, dtype=np.uint8)
    for row, out in zip(pixels, encoded, strict=True):
        out[:] = to_srgb(row) * 255 + 0.5
    Image.fromarray(encoded).save(path)


def read(path: Path) -> np.ndarray:
    """Read a PNG as linear RGB of shape (height, width, 3), without its alpha channel.

    Raises:
        ValueError: not a PNG, a damaged one, or one that is not RGB or RGBA.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path, formats=["PNG"]) as image:
            mode = image.mode
            pixels = np.asarray(image)
    except (
        UnidentifiedImageError,
        OSError,
        ValueError,
        SyntaxError,
        Image.DecompressionBombError,
    ) as error:
        raise ValueError(f"{path}: not a readable PNG: {error}") from None
    if mode not in ("RGB", "RGBA"):
        raise ValueError(f"{path}: not an RGB image; its mode is {mode}")
    return from_srgb(pixels[..., :3] / 255)
