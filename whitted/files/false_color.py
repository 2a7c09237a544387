"""Signed values as colours: blue below 0, white at 0, red above, with a colour bar below."""

import math
from pathlib import Path

import numpy as np

from .atomic import atomically
from .images import rgb

# Percentile of the absolute values that the scale ends at. Derivatives have rare, large values at
# edges; a scale up to the largest would leave all other pixels nearly white.
PERCENTILE = 99.5
# sRGB colours of the scale's ends: "RdBu" of ColorBrewer, safe for colour-blind readers
NEGATIVE, POSITIVE = np.array([33, 102, 172]), np.array([178, 24, 43])
# Grey level around the picture: any but the white that stands for 0
GREY = 225
# Pixels: space around text, height of a line of text, height of the colour bar, and the least
# width of the PNG, which has room for three numbers
MARGIN, LINE, BAR, LEAST_WIDTH = 6, 15, 10, 180


def write_diverging(path: str | Path, image: object, title: str) -> tuple[float, float]:
    """Write the mean of an image's channels as a PNG in diverging colours, with a colour bar.

    The colours run from -scale to +scale. The scale is the 99.5th percentile of the absolute
    values, or the largest one where that percentile is 0.

    Args:
        path: ends in .png.
        image: of shape (height, width, 3), a Dr.Jit tensor or anything that NumPy converts to an
            array. Each pixel becomes one pixel of the PNG; NaN is black.
        title: printed above the colour bar.

    Returns:
        The scale, and the fraction of the pixels that lie beyond it or are NaN.

    Raises:
        ValueError: another suffix, or another shape.
        OSError: the file cannot be written; an old one stays as it was.
    """
    path = Path(path)
    if path.suffix.lower() != ".png":
        raise ValueError(f"{path}: expected a file name that ends in .png")
    pixels = rgb(path, image)
    with np.errstate(invalid="ignore", over="ignore"):
        values = pixels.mean(axis=-1)
    scale = _scale(values)
    clipped = float(np.mean(~(abs(values) <= scale)))
    numbers = (f"{-scale:.3g}", "0", f"{scale:+.3g}") if scale else ("", "0", "")
    note = f"{clipped:.2%} of the pixels clipped" if clipped else ""
    atomically(path, lambda temporary: _draw(temporary, values, scale, title, numbers, note))
    return scale, clipped


def _scale(values: np.ndarray) -> float:
    sizes = abs(values[np.isfinite(values)])
    return float(np.percentile(sizes, PERCENTILE) or sizes.max()) if sizes.size else 0.0


def _colors(values: np.ndarray, scale: float) -> np.ndarray:
    """The 8-bit sRGB colours of values, with one more axis; NaN is black."""
    t = (np.clip(values, -scale, scale) / (scale or 1.0))[..., None]
    colors = 255 - abs(t) * (255 - np.where(t < 0, NEGATIVE, POSITIVE))
    return np.where(np.isnan(t), 0, colors + 0.5).astype(np.uint8)


def _draw(
    path: Path, values: np.ndarray, scale: float, title: str, numbers: tuple[str, ...], note: str
) -> None:
    """Write the PNG: from the top, the picture, the title, the bar, its numbers, and the note."""
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default()
    height, width = values.shape
    full_width = max(width, LEAST_WIDTH, math.ceil(font.getlength(title)) + 2 * MARGIN)
    canvas = np.full((height + 2 * MARGIN + 3 * LINE + BAR, full_width, 3), GREY, dtype=np.uint8)
    # The picture, row by row: the colours of a large one take much memory in floating point
    left = (full_width - width) // 2
    for row, out in zip(values, canvas, strict=False):
        out[left : left + width] = _colors(row, scale)
    # The bar, each column in the colour of its value
    top, bar_width = height + MARGIN + LINE, full_width - 2 * MARGIN
    canvas[top : top + BAR, MARGIN : MARGIN + bar_width] = _colors(
        np.linspace(-1, 1, bar_width), 1.0
    )
    picture = Image.fromarray(canvas)
    draw = ImageDraw.Draw(picture)
    # Text at the left (0), in the middle (0.5) and at the right (1) of the bar
    texts = [(height + MARGIN, 0.5, title), (top + BAR + LINE, 0.5, note)]
    texts += [(top + BAR, at, number) for at, number in zip((0, 0.5, 1), numbers, strict=True)]
    for y, at, text in texts:
        x = MARGIN + round(at * (bar_width - font.getlength(text)))
        draw.text((x, y), text, fill="black", font=font)
    picture.save(path)
