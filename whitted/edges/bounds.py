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

# Takes pixels, and returns the least and the greatest radiance of the samples in each: (3, N)
RangeOf = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def cut_off(
    image: np.ndarray, start: np.ndarray, moves: Moves, own_range: RangeOf
) -> np.ndarray | None:
    """Cut an image's numbers off at what was seen in and around their pixels.

    Args:
        image: flat, with RGB interleaved; it is changed.
        start: the image before edges moved anything.
        moves: what edges have moved.

    Returns:
        Bool, in the shape of the image: the number was cut off; None if none was.
    """
    behind = moves.before - moves.jump
    least, most = np.minimum(moves.before, behind), np.maximum(moves.before, behind)
    values, first = image.reshape(-1, 3).T, start.reshape(-1, 3).T
    # Most pixels lie between what one of their edges has on its two sides
    suspects = []
    for ends in moves.pixel:
        here = np.flatnonzero(ends >= 0)
        value, own = values.take(ends.take(here), 1), first.take(ends.take(here), 1)
        low = np.minimum(own, least.take(here, 1))
        high = np.maximum(own, most.take(here, 1))
        suspects.append(ends.take(here[((value < low) | (value > high)).any(0)]))
    pixels = np.unique(np.concatenate(suspects))
    if not pixels.size:
        return None
    low, high = own_range(pixels)
    for ends in moves.pixel:
        place = np.minimum(np.searchsorted(pixels, ends), pixels.size - 1)
        here = np.flatnonzero(pixels.take(place) == ends)
        for channel in range(3):
            np.minimum.at(low[channel], place.take(here), least[channel].take(here))
            np.maximum.at(high[channel], place.take(here), most[channel].take(here))
    value = values.take(pixels, 1)
    inside = np.clip(value, low, high)
    values[:, pixels] = inside
    # Rounding alone cuts nothing off
    far = np.abs(value - inside) > LEAST_CUT * (high - low)
    if not far.any():
        return None
    cut = np.zeros((len(image) // 3, 3), bool)
    cut[pixels] = far.T
    return cut.ravel()
