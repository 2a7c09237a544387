"""Samples on grids, and which neighbours have an edge in between.

All of it is NumPy, and in an order that does not depend on threads. A band's pixels are numbered
row by row. Image positions and lengths are in pixels.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from .labels import labels_differ

# These stand in place of a pixel's number. OUTSIDE: the sample is in the margin of its grid.
# DONE_BY_OTHER: the grid to the left or above has the same sample, and does all that concerns it
OUTSIDE, DONE_BY_OTHER = -1, -2


@dataclass(frozen=True)
class Samples:
    """Samples on grids of the same shape; all columns but `labels` have one row for each sample."""

    labels: np.ndarray  # (grids, rows, columns)
    x: np.ndarray  # image position
    y: np.ndarray
    pixel: np.ndarray  # the pixel that a sample counts for, OUTSIDE or DONE_BY_OTHER
    # Where grids share samples: for each the place of the one, at the same position, that counts
    twin: np.ndarray | None
    side: int  # samples along a pixel's side
    first: int  # number of the first sample
    top: int  # the row of pixels from which y counts
    few_alike: bool = False  # few trees of rays are equal

    def heights(self, place: np.ndarray) -> np.ndarray:
        """The image positions y at some places, the same in every band, to the last bit."""
        if not self.top:
            return self.y.take(place)
        row = place // self.labels.shape[2] + (self.top - 1) * self.side
        return (row + 0.5) / self.side

    def counted(self, place: np.ndarray) -> np.ndarray:
        """The places of the samples that stand for those at some places."""
        return place if self.twin is None else self.twin.take(place)


def band_samples(labels: np.ndarray, side: int, first_row: int, few_alike: bool = False) -> Samples:
    """The samples of a band with a margin of one pixel, row by row."""
    grid = _band_grid(labels.shape, side)
    return Samples(labels[None], *grid, None, side, 0, first_row, few_alike)


@lru_cache(maxsize=2)
def _band_grid(shape: tuple[int, int], side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each sample of a band with a margin its position and its pixel."""
    rows, columns = shape[0] // side - 2, shape[1] // side - 2
    j, i = np.divmod(np.arange(shape[0] * shape[1]), shape[1])
    x, y = i // side - 1, j // side - 1
    inside = (x >= 0) & (y >= 0) & (x < columns) & (y < rows)
    pixel = np.where(inside, y * columns + x, OUTSIDE)
    return (i - side + 0.5) / side, (j - side + 0.5) / side, pixel.astype(np.int32)


def fine_samples(
    pixels: np.ndarray, side: int, columns: int, first_row: int
) -> tuple[Samples, np.ndarray]:
    """side * side samples in each of some pixels of a band, and a ring of samples around each.

    Args:
        pixels: numbers, in order.

    Returns:
        The samples, with labels to be filled in, and the places of those to be traced. The corners
        of a ring have no use. A sample of a ring that lies in another one of the pixels is traced
        there.
    """
    column, row = pixels % columns, pixels // columns
    grid, x, y, corners, inside = _ring(side)
    x = ((column * side)[:, None] + x) / side
    y = (((row + first_row) * side)[:, None] + y) / side
    pixel, traced = np.where(inside, pixels[:, None], OUTSIDE), np.ones(x.shape, bool)
    traced[:, corners] = False
    twin = np.arange(pixel.size).reshape(pixel.shape)

    # What rings share with the pixel to the right or below
    right = np.flatnonzero((np.diff(pixels) == 1) & (column[1:] > 0))
    below = np.searchsorted(pixels[:-1], pixels + columns)
    above = np.flatnonzero(pixels.take(below) == pixels + columns)
    for a, b, across in ((right, right + 1, grid.T), (above, below[above], grid)):
        out, last, first, back = across[[-1, -2, 1, 0], 1:-1]
        of_a, of_b = (a[:, None], out), (b[:, None], back)
        twin[of_a], twin[of_b] = b[:, None] * grid.size + first, a[:, None] * grid.size + last
        traced[of_a] = traced[of_b] = False
        pixel[of_b] = DONE_BY_OTHER
    labels = np.empty((len(pixels), *grid.shape), np.uint32)
    samples = Samples(labels, x.ravel(), y.ravel(), pixel.ravel(), twin.ravel(), side, 0, 0)
    return samples, np.flatnonzero(traced)


def samples_inside(shape: tuple[int, ...]) -> np.ndarray:
    """The places of the samples inside of grids with rings: (samples of a grid, grids)."""
    places = np.arange(shape[0] * shape[1] * shape[2]).reshape(shape)
    return places[:, 1:-1, 1:-1].reshape(shape[0], -1).T


def regular_samples(
    pixels: np.ndarray, side: int, columns: int, first_row: int
) -> tuple[np.ndarray, np.ndarray]:
    """The image positions of the samples of some pixels of a band: (side * side, N)."""
    j, i = np.divmod(np.arange(side * side)[:, None], side)
    row = pixels // columns + first_row
    return pixels % columns + (i + 0.5) / side, row + (j + 0.5) / side


@lru_cache(maxsize=4)
def _ring(side: int) -> tuple[np.ndarray, ...]:
    """A grid of side * side places and a ring around them.

    Returns:
        The places, in rows; the column and the row of each one's center, counted from the first
        place inside; the places of the corners; and for each place, bool: it is inside.
    """
    ring = np.arange(-1, side + 1)
    grid = np.arange(ring.size**2).reshape(ring.size, ring.size)
    inside = np.zeros(grid.shape, bool)
    inside[1:-1, 1:-1] = True
    row, column = np.meshgrid(ring + 0.5, ring + 0.5, indexing="ij")
    corners = grid[[0, 0, -1, -1], [0, -1, 0, -1]]
    return grid, column.ravel(), row.ravel(), corners, inside.ravel()


def neighbours_across_edges(samples: Samples) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Neighbours whose labels differ.

    Returns:
        The places of the neighbours a and b, and (2, N) their pixels. At least one of a pair's two
        numbers is a pixel.
    """
    labels, columns = samples.labels.ravel(), samples.labels.shape[2]
    places = [(np.flatnonzero(labels[step:] != labels[:-step]), step) for step in (1, columns)]
    a = np.concatenate([first for first, _ in places])
    b = np.concatenate([first + step for first, step in places])
    if labels.itemsize == 8:
        kept = np.flatnonzero(labels_differ(labels.take(a), labels.take(b)))
        a, b = a.take(kept), b.take(kept)
    ends = samples.pixel.take(np.stack([a, b]))
    # Drop pairs outside. Those from the end of a row to the start of the next one are among them
    kept = np.flatnonzero((np.maximum(*ends) >= 0) & (ends[0] != DONE_BY_OTHER))
    a, b, ends = a.take(kept), b.take(kept), ends.take(kept, 1)
    if samples.twin is not None:
        ends[1] = samples.pixel.take(samples.counted(b))
    return a, b, ends


def label_counts(samples: Samples, pixels: np.ndarray) -> np.ndarray:
    """How many labels each pixel's own samples and the nearest ones around it have."""
    side, stride = samples.side, samples.labels.shape[2]
    columns = stride // side - 2
    start = (pixels // columns + 1) * side * stride + (pixels % columns + 1) * side
    labels = samples.labels.ravel().take(start + _window(side, stride)[:, None])
    if labels.itemsize == 4:
        return _distinct(labels)
    halves = labels.astype(np.uint32), (labels >> 32).astype(np.uint32)
    return np.minimum(*(_distinct(half) for half in halves))


def _distinct(labels: np.ndarray) -> np.ndarray:
    """How many different labels each column has."""
    if len(labels) == 5:
        # For so few, comparing all is faster than sorting
        new = [~np.logical_or.reduce(labels[:k] == labels[k], 0) for k in range(1, 5)]
        return 1 + np.add.reduce(new, 0, dtype=np.uint16)
    ordered = np.sort(labels, 0)
    return 1 + np.add.reduce(ordered[1:] != ordered[:-1], 0, dtype=np.uint16)


@lru_cache(maxsize=4)
def _window(side: int, stride: int) -> np.ndarray:
    """The places of a pixel's own samples and the nearest ones around it.

    They count from the pixel's first sample, in rows of `stride` samples.
    """
    across, inner = np.meshgrid(np.arange(-1, side + 1), np.arange(side))
    return np.unique(np.concatenate([inner * stride + across, across * stride + inner]))
