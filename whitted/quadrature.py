"""Samples that integrate radiance between two neighbours with an edge in between, in place of the two.

On one side of a silhouette, where the sphere is, radiance is a + b sqrt(distance) + c distance + ..., because so is the
normal, and its derivative a / sqrt(distance) + b + ...; the same holds where refraction ends in total reflection. There
two of Gauss's points in sqrt(distance) integrate radiance up to the term in distance, and its derivative as far. They
also do better than samples where a surface, met at a small angle, runs off into the distance between the two. On the
other side there is one sample, in the middle. The border between the two neighbours' cells cuts one of the sides; the
part between it and the edge has a sample of its own. Where several edges are between the neighbours, as where curved
mirrors touch, what lies between two of them is small and bright, and each part is cut into pieces with as many samples.
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


def nodes(stretch: Stretch, pieces: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The samples, shape (4 pieces, stretches): image position, weight, and whether they are in b's cell and behind the edge.

    The first quarter lies between the edge and the cells' border, the next two beyond both on the side of the square root,
    the last on the other.

    Args:
        pieces: into which each of the three parts is cut, those on the side of the square root at equal steps of it.
    """
    c, rooted = stretch.edge, stretch.rooted
    border = np.minimum(np.maximum(stretch.length / 2, stretch.start), stretch.stop)
    between, cut = np.abs(c - border), c < border
    facing = cut == rooted
    before, after = c - stretch.start, stretch.stop - c

    # From where to where the parts beyond both are, as distances from the edge
    low, start = np.where(facing, between, 0), np.where(facing, 0, between)
    high, stop = np.maximum(np.where(rooted, after, before), low), np.maximum(np.where(rooted, before, after), start)
    middle = ((np.arange(pieces) + 0.5) / pieces)[:, None]
    u, v = np.sqrt(low), np.sqrt(high)
    width = (v - u) / pieces
    mean, spread = u + (v - u) * middle, width * (3**-0.5 / 2)
    first, second = mean - spread, mean + spread
    smooth, near = start + (stop - start) * middle, np.where(facing, middle * middle, middle)
    distance = between * near, first * first, second * second, smooth
    part = np.where(facing, 2 * middle, 1)
    weight = between * part / pieces, width * first, width * second, (stop - start) * np.ones_like(middle) / pieces

    behind, in_b = (np.repeat([where, rooted, rooted, ~rooted], pieces, 0) for where in (cut, ~cut))
    along = np.where(behind, c + np.concatenate(distance), c - np.concatenate(distance))
    x, y = stretch.x + along * ~stretch.vertical, stretch.y + along * stretch.vertical
    return x, y, np.concatenate(weight) * stretch.weight, in_b, behind
