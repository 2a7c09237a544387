"""Tables: dataclasses of NumPy arrays, each of which is a column.

The last axis of a column counts the rows, since NumPy is slow on a short last axis.
"""

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

Table = TypeVar("Table")


def rows_of(table: Table, which: np.ndarray) -> Table:
    """Some rows, by number."""
    return type(table)(*(column.take(which, -1) for column in vars(table).values()))


def concatenated(tables: Sequence[Table]) -> Table:
    """The rows of several tables."""
    columns = zip(*(vars(table).values() for table in tables), strict=True)
    return type(tables[0])(*(np.concatenate(column, -1) for column in columns))


def deposit(image: np.ndarray, pixel: np.ndarray, *channels: np.ndarray) -> None:
    """Add to an image's pixels, in order, so that sums are the same to the last bit.

    Args:
        image: flat, its channels interleaved.
        pixel: any shape; numbers below 0 stand for no pixel.
        channels: the values of each channel, in the shape of `pixel`.
    """
    kept = np.flatnonzero(pixel >= 0)
    # Converted once: NumPy would convert other integers for each channel
    place, columns = pixel.take(kept).astype(np.intp), image.reshape(-1, len(channels)).T
    for column, values in zip(columns, channels, strict=True):
        np.add.at(column, place, values.take(kept).astype(image.dtype, copy=False))
