"""Samples that integrate radiance between two neighbours with an edge in between, in place of the two.

On one side of a silhouette, where the sphere is, radiance is a + b sqrt(distance) + c distance + ..., because so is the
normal, and its derivative a / sqrt(distance) + b + ...; the same holds where refraction ends in total reflection. There
two of Gauss's points in sqrt(distance) integrate radiance up to the term in distance, and its derivative as far. On the
other side there is one sample, in the middle. The border between the two neighbours' cells cuts one of the sides; the
part between it and the edge has a sample of its own.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Stretch:
    """The line through two neighbours a and b, or the part of it that is nearest to one of its edges; columns of a table.

    Distances are from a, in pixels, along the line.
    """

    x: np.ndarray  # image position of a
    y: np.ndarray
    vertical: np.ndarray  # bool: b is below a, not to the right
    length: np.ndarray  # from a to b
    edge: np.ndarray
    start: np.ndarray
    stop: np.ndarray
    rooted: np.ndarray  # bool: the square root is behind the edge, not before it
    weight: np.ndarray  # in the pixel of a or that of b, for a unit of length


def nodes(stretch: Stretch) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The samples, shape (4, stretches): image position, weight, and whether they are in b's cell and behind the edge.

    Number 0 lies between the edge and the cells' border, 1 and 2 beyond both on the side of the square root, 3 on the other.
    """
    c, rooted = stretch.edge, stretch.rooted
    border = np.minimum(np.maximum(stretch.length / 2, stretch.start), stretch.stop)
    between, cut = np.abs(c - border), c < border
    facing = cut == rooted
    before, after = c - stretch.start, stretch.stop - c

    # From where to where the parts beyond both are, as distances from the edge
    low, start = np.where(facing, between, 0), np.where(facing, 0, between)
    high, stop = np.maximum(np.where(rooted, after, before), low), np.maximum(np.where(rooted, before, after), start)
    u, v = np.sqrt(low), np.sqrt(high)
    mean, spread = (u + v) / 2, (v - u) * (3**-0.5 / 2)
    first, second = mean - spread, mean + spread
    distance = np.stack([between * np.where(facing, 0.25, 0.5), first * first, second * second, (start + stop) / 2])
    weight = np.stack([between, (v - u) * first, (v - u) * second, stop - start]) * stretch.weight

    behind, in_b = np.stack([cut, rooted, rooted, ~rooted]), np.stack([~cut, rooted, rooted, ~rooted])
    along = np.where(behind, c + distance, c - distance)
    return stretch.x + along * ~stretch.vertical, stretch.y + along * stretch.vertical, weight, in_b, behind
