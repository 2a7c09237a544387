"""A picture as a Zarr pyramid: level 0 is the picture, each further one half as wide and high.

Workers write the chunks of level 0. The others are made of it, one row of chunks at a time.
"""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .libraries import require
from .store import check_seen, remove, remove_partial

# Pixels along the side of a chunk
CHUNK = 256


@contextmanager
def new_pyramid(
    path: Path, size: tuple[int, int], dtype: np.dtype, attributes: dict[str, str | int]
) -> Iterator[Path]:
    """A pyramid under another name, whose level 0 is to be filled in; then it gets its name.

    Args:
        size: width and height of the picture.
    """
    zarr = require("zarr")
    temporary = path.with_name(f".{path.stem[:20]}-{os.getpid()}-{secrets.token_hex(4)}.zarr")
    levels = [size]
    while max(levels[-1]) > CHUNK:
        width, height = levels[-1]
        levels.append((-(-width // 2), -(-height // 2)))
    try:
        group = zarr.create_group(str(temporary), attributes={**attributes, "levels": len(levels)})
        for level, (width, height) in enumerate(levels):
            group.create_array(
                str(level),
                shape=(height, width, 3),
                chunks=(min(CHUNK, height), min(CHUNK, width), 3),
                dtype=dtype,
                fill_value=np.nan,
                dimension_names=(f"y{level}", f"x{level}", "channel"),
            )
        yield temporary
        for level in range(1, len(levels)):
            _halve(group, level)
        # A chunk is a file in folders for its row and its column
        for folder in temporary.glob("0/c/*/*"):
            remove_partial(folder)
        temporary.rename(path)
    finally:
        remove(temporary)


def write_band(path: str, first: int, pixels: np.ndarray) -> None:
    """Write a band of rows of level 0, of whole chunks but for the last one."""
    check_seen(Path(path))
    require("zarr").open_group(path, mode="r+")["0"][first : first + len(pixels)] = pixels


def _halve(group: Any, level: int) -> None:
    """Fill a level: each pixel is the mean of those of the level before that it covers."""
    above, here = group[str(level - 1)], group[str(level)]
    for first in range(0, here.shape[0], CHUNK):
        rows = above[2 * first : 2 * (first + CHUNK)]
        here[first : first + CHUNK] = halved(rows)


def halved(pixels: np.ndarray) -> np.ndarray:
    """The means of 2 x 2 pixels; at odd ends, of those that are there."""
    for axis in (0, 1):
        if pixels.shape[axis] % 2:
            pixels = np.concatenate([pixels, pixels.take([-1], axis)], axis)
    height, width, _ = pixels.shape
    blocks = pixels.reshape(height // 2, 2, width // 2, 2, 3)
    means: np.ndarray = blocks.mean((1, 3), dtype=np.float64).astype(pixels.dtype)
    return means
