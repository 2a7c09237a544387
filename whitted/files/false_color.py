"""Pictures of values of both signs: blue below 0, white at 0, red above, with the scale printed
below the picture.
"""

import math
from pathlib import Path

import numpy as np

from .atomic import atomically
from .images import rgb

# The scale leaves the largest values out, so that one pixel does not turn all others white
PERCENTILE = 99.5
# The ends of the scale in sRGB; "RdBu" of ColorBrewer, which colour-blind people can read
NEGATIVE, POSITIVE = np.array([33, 102, 172]), np.array([178, 24, 43])
# Around the picture: not the white of 0
PAPER = 225
# In pixels: room around text, a line of text, the colour bar, and the least width for three numbers
MARGIN, LINE, BAR, LEAST_WIDTH = 6, 15, 10, 180


def write_diverging(path: str | Path, image: object, title: str) -> tuple[float, float]:
    """Write the mean of an image's channels as a PNG in diverging colours, above a bar of them with
    its title.

    Args:
        path: ends in .png.
        image: of shape (height, width, 3), a Dr.Jit tensor or what NumPy takes for an array; one
            pixel of it is one of the PNG, black where it is not a number.
        title: is printed above the bar.

    Returns:
        The scale, and the fraction of the pixels that lie beyond it or are not numbers. The colours
        run from -scale to +scale, the 99.5th percentile of the moduli, or the largest where that is
        0.

    Raises:
        ValueError: another ending, or another shape.
        OSError: the file cannot be written; an old one is left as it was.
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
    moduli = abs(values[np.isfinite(values)])
    return float(np.percentile(moduli, PERCENTILE) or moduli.max()) if moduli.size else 0.0


def _colors(values: np.ndarray, scale: float) -> np.ndarray:
    t = (np.clip(values, -scale, scale) / (scale or 1.0))[..., None]
    colors = 255 - abs(t) * (255 - np.where(t < 0, NEGATIVE, POSITIVE))
    return np.where(np.isnan(t), 0, colors + 0.5).astype(np.uint8)


def _draw(
    path: Path, values: np.ndarray, scale: float, title: str, numbers: tuple[str, ...], note: str
) -> None:
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default()
    height, width = values.shape
    wide = max(width, LEAST_WIDTH, math.ceil(font.getlength(title)) + 2 * MARGIN)
    canvas = np.full((height + 2 * MARGIN + 3 * LINE + BAR, wide, 3), PAPER, dtype=np.uint8)
    # The picture, a row at a time, which keeps the colours in floating point out of memory
    left = (wide - width) // 2
    for row, out in zip(values, canvas, strict=False):
        out[left : left + width] = _colors(row, scale)
    # The bar, of which each column has the colour of its own value
    top, across = height + MARGIN + LINE, wide - 2 * MARGIN
    canvas[top : top + BAR, MARGIN : MARGIN + across] = _colors(np.linspace(-1, 1, across), 1.0)
    picture = Image.fromarray(canvas)
    draw = ImageDraw.Draw(picture)
    # Text at the left, in the middle and at the right of the bar
    texts = [(height + MARGIN, 0.5, title), (top + BAR + LINE, 0.5, note)]
    texts += [(top + BAR, at, number) for at, number in zip((0, 0.5, 1), numbers, strict=True)]
    for y, at, text in texts:
        draw.text(
            (MARGIN + round(at * (across - font.getlength(text))), y), text, fill="black", font=font
        )
    picture.save(path)
