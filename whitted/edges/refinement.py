"""Which pixels are sampled anew, and how finely: those where edges meet or crowd.

A pair of samples sees one edge well. Where three labels or more are around a pixel, edges meet, or
several lie between two samples. The corrections of pairs would overlap there. Such a pixel is
sampled anew, with more samples and with pairs of its own (adaptive subdivision: Whitted 1980).

With one sample a pixel, three labels often mean one edge that ends at another; 2 x 2 samples are
enough. Five labels are worth 4 x 4 samples, if there are enough such pixels to pay for a group of
their own. With n x n samples, n up to 4, a pixel gets 4 n x 4 n. With more samples fewer edges
crowd, and 2 n x 2 n are enough.
"""

import numpy as np

from .grid import Samples, label_counts
from .settings import FEW

# Pixels, in order, and their samples along a side
Group = tuple[np.ndarray, int]


def groups_to_refine(samples: Samples, ends: np.ndarray) -> list[Group]:
    """The pixels of a band to sample anew, by how finely.

    Args:
        ends: (2, N), the pixels of neighbours with different labels.
    """
    pixels = crowded(ends, samples.side)
    counts = label_counts(samples, pixels)
    if samples.side > 1:
        return [(pixels[counts > 2], samples.side * (4 if samples.side <= 4 else 2))]
    many = (counts == 5) & (FEW * np.count_nonzero(counts == 5) >= np.count_nonzero(counts > 2))
    return [(pixels[(counts > 2) & ~many], 2), (pixels[many], 4)]


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
