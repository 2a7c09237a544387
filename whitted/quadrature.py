"""Samples that integrate radiance between two neighbours with an edge in between, in place of the two.

On one side of a silhouette, where the sphere is, radiance is a + b sqrt(distance) + c distance + ..., because so is the
normal, and its derivative a / sqrt(distance) + b + ...; the same holds where refraction ends in total reflection. There
two of Gauss's points in sqrt(distance) integrate radiance up to the term in distance, and its derivative as far. On the
other side there is one sample, in the middle. The border between the two neighbours' cells cuts one of the sides; the
part between it and the edge has a sample of its own.
"""

from dataclasses import dataclass

import drjit as dr

from .geometry import Array

NODES = 4


@dataclass
class Stretch:
    """The line through two neighbours a and b, or the part of it that is nearest to one of its edges.

    Distances are from a, in pixels, along the line.
    """

    x: Array  # image position of a
    y: Array
    vertical: Array  # Bool: b is below a, not to the right
    length: Array  # from a to b
    edge: Array
    start: Array
    stop: Array
    rooted: Array  # Bool: the square root is behind the edge, not before it
    weight_a: Array  # in the pixel of a, for a unit of length
    weight_b: Array


def node(stretch: Stretch, k: Array) -> tuple[Array, Array, Array, Array]:
    """The k-th sample: its image position, and its weights in the pixels of a and of b.

    Number 0 lies between the edge and the cells' border, 1 and 2 beyond both on the side of the square root, 3 on the other.
    """
    c, half = stretch.edge, stretch.length / 2
    border = dr.fmin(dr.fmax(half, stretch.start), stretch.stop)
    near, cut = dr.abs(c - border), c < border
    behind = dr.select(k == 0, cut, stretch.rooted ^ (k == 3))
    end = dr.abs(dr.select(behind, stretch.stop, stretch.start) - c)
    low = dr.select((k != 0) & (behind == cut), near, 0)
    high = dr.fmax(dr.select(k == 0, near, end), low)

    # Distance from the edge, and weight
    u, v = dr.sqrt(low), dr.sqrt(high)
    gauss = (k == 1) | (k == 2)
    root = (u + v) / 2 + dr.select(gauss, dr.select(k == 1, -0.5, 0.5) * 3**-0.5, 0) * (v - u)
    middle = (low + high) / 2
    distance = dr.select(behind == stretch.rooted, root * root, middle)
    weight = dr.select(gauss, (v - u) * root, high - low)

    sign = dr.select(behind, 1, -1)
    along, in_b = c + sign * distance, c + sign * middle > half
    x, y = stretch.x + dr.select(stretch.vertical, 0, along), stretch.y + dr.select(stretch.vertical, along, 0)
    return x, y, dr.select(in_b, 0, weight * stretch.weight_a), dr.select(in_b, weight * stretch.weight_b, 0)
