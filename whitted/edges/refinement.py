"""Which pixels are sampled anew, and how finely: those where edges meet or crowd.

A pair of samples sees one edge well. Where three labels or more are around a pixel, edges meet, or
several lie between two samples. The corrections of pairs would overlap there. Such a pixel is
sampled anew, with more samples and with pairs of its own (adaptive subdivision: Whitted 1980).

With n x n samples, n up to 4, such a pixel gets 4 n x 4 n. With more samples fewer edges crowd, and
2 n x 2 n are enough.
"""

import numpy as np

from .grid import Samples, label_counts


def finer_side(side: int) -> int:
    """Samples along the side of a pixel that is sampled anew."""
    return side * (4 if side <= 4 else 2)


def pixels_to_refine(samples: Samples, ends: np.ndarray) -> np.ndarray:
    """The pixels of a band to sample anew, in order.

    Args:
        ends: (2, N), the pixels of neighbours with different labels.
    """
    pixels = crowded(ends, samples.side)
    return pixels[label_counts(samples, pixels) > 2]


def crowded(ends: np.ndarray, side: int) -> np.ndarray:
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
