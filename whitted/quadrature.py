"""Samples that integrate radiance between two neighbours with an edge in between, in place of the two.

On either side of an edge radiance is a + b sqrt(distance) + ..., because near a silhouette so is the normal, and its
derivative a / sqrt(distance) + b + ...; likewise where total reflection begins. Two of Gauss's points in
sqrt(distance) integrate both exactly, on each side, up to the cells' ends. The border between the two samples' cells
cuts one of the sides; the part between it and the edge has a point of its own.
"""

from dataclasses import dataclass

import drjit as dr

from .geometry import Array

NODES = 7


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
    own_a: Array  # the length that a itself stood for
    own_b: Array
    weight_a: Array  # in the pixel of a, for a unit of length
    weight_b: Array


def node(stretch: Stretch, k: Array) -> tuple[Array, Array, Array, Array]:
    """The k-th sample: its image position, and its weights in the pixels of a and of b.

    Number 0 lies between the edge and the cells' border, 1 and 2 before and 3 and 4 behind; 5 and 6 are a and b, taken away.
    """
    c, half = stretch.edge, stretch.length / 2
    border = dr.fmin(dr.fmax(half, stretch.start), stretch.stop)
    near, left = dr.abs(c - border), c < border

    # Gauss's points on one side, beyond the border if that is where it lies
    behind = k >= 3
    inner = dr.sqrt(dr.select(left == behind, near, 0))
    end = dr.abs(dr.select(behind, stretch.stop, stretch.start) - c)
    outer = dr.fmax(dr.sqrt(end), inner)
    root = (inner + outer) / 2 + dr.select((k == 1) | (k == 3), -1, 1) * (outer - inner) * 0.5 / 3**0.5
    sign = dr.select(behind, 1, -1)
    along, weight = c + sign * root * root, (outer - inner) * root
    middle = c + sign * (inner * inner + outer * outer) / 2

    between = dr.select(left, near, -near)
    along, weight = dr.select(k == 0, c + between / 4, along), dr.select(k == 0, near, weight)
    middle = dr.select(k == 0, c + between / 2, middle)
    own = k >= 5
    along = dr.select(own, dr.select(k == 5, 0, stretch.length), along)
    weight = dr.select(own, -dr.select(k == 5, stretch.own_a, stretch.own_b), weight)
    in_b = dr.select(own, k == 6, middle > half)
    x, y = stretch.x + dr.select(stretch.vertical, 0, along), stretch.y + dr.select(stretch.vertical, along, 0)
    return x, y, dr.select(in_b, 0, weight * stretch.weight_a), dr.select(in_b, weight * stretch.weight_b, 0)
