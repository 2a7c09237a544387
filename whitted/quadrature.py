"""Samples that integrate radiance between two neighbours with an edge in between, in place of the two.

On one side of a silhouette, where the sphere is, radiance is a + b sqrt(distance) + c distance + ..., because so is the
normal, and its derivative a / sqrt(distance) + b + ...; the same holds where refraction ends in total reflection. There
two of Gauss's points in sqrt(distance) integrate radiance up to the term in distance, and its derivative as far. On the
other side there is one sample, in the middle. The border between the two neighbours' cells cuts one of the sides; the
part between it and the edge has a sample of its own.
"""

from dataclasses import dataclass

import numpy as np

NODES = 4


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
    """The samples, shape (NODES, stretches): image position, weight, and whether they are in b's cell and behind the edge.

    Number 0 lies between the edge and the cells' border, 1 and 2 beyond both on the side of the square root, 3 on the other.
    """
    k = np.arange(NODES)[:, None]
    c, half = stretch.edge, stretch.length / 2
    border = np.minimum(np.maximum(half, stretch.start), stretch.stop)
    near, cut = np.abs(c - border), c < border
    behind = np.where(k == 0, cut, stretch.rooted ^ (k == 3))
    end = np.abs(np.where(behind, stretch.stop, stretch.start) - c)
    low = np.where((k != 0) & (behind == cut), near, 0)
    high = np.maximum(np.where(k == 0, near, end), low)

    # Distance from the edge, and weight
    u, v = np.sqrt(low), np.sqrt(high)
    gauss = (k == 1) | (k == 2)
    root = (u + v) / 2 + np.array([[0], [-0.5], [0.5], [0]]) * 3**-0.5 * (v - u)
    middle = (low + high) / 2
    distance = np.where(behind == stretch.rooted, root * root, middle)
    weight = np.where(gauss, (v - u) * root, high - low)

    sign = np.where(behind, 1, -1)
    along = c + sign * distance
    x, y = stretch.x + np.where(stretch.vertical, 0, along), stretch.y + np.where(stretch.vertical, along, 0)
    return x, y, weight * stretch.weight, c + sign * middle > half, behind
