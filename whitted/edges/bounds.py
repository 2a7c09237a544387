"""Pixels stay within the range of the radiance that their samples saw.

What edges move is a sum of parts, each of which is right for one edge. Where an edge bends within a
pixel, or several lie close together, the sum can take more from a pixel than the pixel has. A mean
of radiance is never outside the range of that radiance, so a pixel is cut off there. That brings it
closer to the truth, whatever that is. As a cut pixel does not follow its edges, its derivative has
no boundary term.
"""

from collections.abc import Callable

import numpy as np

from .pairs import Moves
from .settings import LEAST_CUT

# Takes pixels and their radiance before edges moved anything, (3, N). Returns the least and the
# greatest radiance of the samples in each, which may be arrays to be changed
RangeOf = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

# Pixels that were cut off, in order, and (3, N) Bool: this channel was
Cut = tuple[np.ndarray, np.ndarray]


def numbers_of(image: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """The channels of some pixels of a flat image: (3, N)."""
    return image.take(3 * pixels.astype(np.intp) + np.arange(3)[:, None])


def places_among(pixels: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where numbers are among some pixels, in order, at least one; and Bool: they are."""
    place = np.minimum(np.searchsorted(pixels, ends), pixels.size - 1)
    return place, pixels.take(place) == ends


def cut_off(image: np.ndarray, start: np.ndarray, moves: Moves, own_range: RangeOf) -> Cut:
    """Cut an image's numbers off at what was seen in and around their pixels.

    Args:
        image: flat, with RGB interleaved; it is changed.
        start: (3, 2 N), the pixels of the moves, the first of each and then the second, before
            edges moved anything.
        moves: what edges have moved.

    Returns:
        The pixels that were cut off, in order, and (3, N) Bool: this channel was.
    """
    ends, behind = moves.pixel.ravel(), moves.before - moves.jump
    least = np.tile(np.minimum(moves.before, behind), 2)
    most = np.tile(np.maximum(moves.before, behind), 2)
    # Most pixels lie between what one of their edges has on its two sides
    value = numbers_of(image, ends)
    outside = (value < np.minimum(start, least)) | (value > np.maximum(start, most))
    pixels = np.unique(ends[(outside[0] | outside[1] | outside[2]) & (ends >= 0)])
    if not pixels.size:
        return pixels, np.zeros((3, 0), bool)
    # Which of the moves these pixels are in
    place, known = places_among(pixels, ends)
    here = np.flatnonzero(known)
    place, before = place.take(here), np.empty((3, pixels.size), image.dtype)
    before[:, place] = start.take(here, 1)
    low, high = own_range(pixels, before)
    for channel in range(3):
        np.minimum.at(low[channel], place, least[channel].take(here))
        np.maximum.at(high[channel], place, most[channel].take(here))
    value = numbers_of(image, pixels)
    inside = np.clip(value, low, high)
    image.reshape(-1, 3)[pixels] = inside.T
    # Rounding alone cuts nothing off
    far = np.abs(value - inside) > LEAST_CUT * (high - low)
    cut = far.any(0)
    return pixels[cut], far[:, cut]
