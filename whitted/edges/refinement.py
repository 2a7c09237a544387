"""Which pixels are sampled anew, and how finely: those where edges meet or crowd.

A pair of samples sees one edge well. Where three labels or more are around a pixel, the corrections
of pairs would overlap. Such a pixel is sampled anew (adaptive subdivision: Whitted 1980).

Where few labels are around it, edges meet. The pixel gets finer samples, whose pairs are searched
for edges as all others are. Where there are more labels, edges crowd, and to search for all of them
would cost more than it is worth. Such a pixel is the mean of many samples. For its derivatives see
`blocks.py`.
"""

import functools
from collections.abc import Callable, Sequence

import numpy as np

from ..core.arrays import Array
from ..core.host import chunks, stacked, to_numpy
from ..sampling.band import Band
from . import kernels, settings
from .grid import Samples, label_counts


def finer_side(side: int) -> int:
    """Samples along the side of a pixel where edges meet.

    With more samples fewer edges meet between two, and fewer of the finer samples are enough.
    """
    return {1: 4, 2: 6, 3: 12, 4: 16}.get(side, 2 * side)


def crowd_side(side: int, everywhere: bool = False) -> int:
    """Samples along the side of a pixel where edges crowd.

    Args:
        everywhere: all pixels with edges are crowds.
    """
    return 2 * side if everywhere else {1: 4, 2: 10, 3: 12}.get(side, 4 * side)


def crowd_side_of(band: Band) -> int:
    """The same for the pixels of a band."""
    return crowd_side(band.side, kernels.crowds_everywhere(band.structure))


def searches_crowds(band: Band) -> bool:
    """Whether derivatives have crowds searched for their edges, like other pixels."""
    everywhere = kernels.crowds_everywhere(band.structure)
    return band.side >= settings.SEARCHED_SIDE and not everywhere


def in_tiles(band: Band, pixels: np.ndarray) -> np.ndarray:
    """Pixels in tiles of 2 x 2, so that samples that are traced together are close to each other.

    The order is the same in all bands.
    """
    row, column = np.divmod(pixels, band.resolution[0])
    row = row + band.first_row
    tile = (row >> 1) * (band.resolution[0] + 1) + (column >> 1)
    return pixels.take(np.argsort((tile << 2) + ((row & 1) << 1) + (column & 1), kind="stable"))


def crowd_means(band: Band, pixels: np.ndarray, dim: bool) -> Callable[[], np.ndarray]:
    """Begin to trace pixels where edges crowd.

    Dim rays have few edges that are seen. They are left out of the finer samples; their light is
    that of as many samples as a pixel has elsewhere.

    Args:
        pixels: numbers in the band.
        dim: with the light of dim rays.

    Returns:
        A function that waits for the pixels' radiance: (N, 3).
    """
    dense = crowd_side_of(band)
    # By the samples along a pixel's side, Bool: of dim rays
    grids = [(dense, False), *([(band.side, True)] if dim else [])]
    parts = list(chunks(len(pixels), settings.SAMPLES // dense**2))
    traced = [_rows(band, pixels[part], grids) for part in parts]

    def finish() -> np.ndarray:
        result = np.zeros((len(pixels), 3), band.dtype)
        for part, sums in zip(parts, traced, strict=True):
            rows, stop = to_numpy(sums), 0
            for side, _ in grids:
                start, stop = stop, stop + len(result[part]) * side
                own = stacked(rows, slice(start, stop)).reshape(3, -1, side)
                result[part] += summed(own).T / side**2
        return result

    return finish


def summed(values: np.ndarray) -> np.ndarray:
    """The sum over a short last axis, in order. NumPy's own is slow there."""
    return functools.reduce(np.add, np.moveaxis(values, -1, 0))


def _rows(band: Band, pixels: np.ndarray, grids: Sequence[tuple[int, bool]]) -> Array:
    """The sums of the rows of samples in pixels, on one grid after the other."""
    columns = [
        np.concatenate(column)
        for column in zip(*(_rows_of(band, pixels, *grid) for grid in grids), strict=True)
    ]
    return kernels.rows_of_samples(*band.inputs, *band.lanes(*columns))


def _rows_of(band: Band, pixels: np.ndarray, side: int, dim: bool) -> tuple[np.ndarray, ...]:
    """The first samples of rows, the samples' distance and number, and whether of dim rays."""
    columns, first = band.resolution[0], (np.arange(side) + 0.5) / side
    x = np.repeat(pixels % columns + first[0], side)
    y = (pixels // columns + band.first_row + first[:, None]).T.ravel()
    step, count = np.full(len(x), 1 / side), np.full(len(x), side, np.uint32)
    return x, y, step, count, np.full(len(x), dim)


def pixels_to_refine(
    samples: Samples, ends: np.ndarray, everywhere: bool
) -> tuple[np.ndarray, np.ndarray]:
    """The pixels of a band to sample anew, in order: where edges meet, and where they crowd.

    Args:
        ends: (2, N), the pixels of neighbours with different labels.
        everywhere: as of `crowd_side`: all pixels with edges are crowds.
    """
    if everywhere:
        # In a list of all pixels, which has one place more for those outside
        touched = np.zeros(samples.labels.size + 1, bool)
        touched[ends] = True
        pixels = np.flatnonzero(touched[:-1])
        return pixels[:0], pixels
    pixels = candidates(ends, samples.side)
    count = label_counts(samples, pixels)
    most = settings.MEETING[samples.side > 1]
    if samples.side >= settings.ALL_SEARCHED_SIDE:
        most = samples.labels.size
    return pixels[(count > 2) & (count <= most)], pixels[count > most]


def candidates(ends: np.ndarray, side: int) -> np.ndarray:
    """The pixels around which three labels may be.

    Args:
        ends: (2, N), the pixels of neighbours with different labels.
        side: samples along a pixel's side.
    """
    touched = np.sort(ends, None)
    touched = touched[np.searchsorted(touched, 0) :]
    again = np.diff(touched, prepend=-1) == 0
    # With one sample a pixel, three labels take two pairs. With several samples, one pair may tell
    # of three labels
    firsts = np.flatnonzero(again[1:] > again[:-1]) + 1 if side == 1 else np.flatnonzero(~again)
    return touched.take(firsts)
