"""Samples that integrate radiance between two neighbours with an edge in between, in place of the two.

On one side of a silhouette, where the sphere is, radiance is a + b sqrt(distance) + ..., because so is the normal, and its
derivative a / sqrt(distance) + b + ...; the same holds where refraction ends in total reflection. There one sample, well
placed, integrates the first two terms exactly: between the distances u^2 and v^2 from the edge, of the weight
v^2 - u^2, it lies at the square of 2/3 (v^3 - u^3) / (v^2 - u^2) for radiance, and of (u + v) / 2 for the derivative. On the
other side it lies in the middle. The border between the cells of the two neighbours cuts one of the sides in two.
"""

from dataclasses import dataclass

import drjit as dr

from .geometry import Array

NODES = 3


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


def node(stretch: Stretch, k: Array, derivative: bool) -> tuple[Array, Array, Array, Array]:
    """The k-th sample: its image position, and its weights in the pixels of a and of b.

    Number 0 lies between the edge and the cells' border, 1 before and 2 behind both.

    Args:
        derivative: the samples are for the derivative of radiance, not for radiance.
    """
    c, half = stretch.edge, stretch.length / 2
    border = dr.fmin(dr.fmax(half, stretch.start), stretch.stop)
    near = dr.abs(c - border)
    behind = dr.select(k == 0, c < border, k == 2)
    end = dr.abs(dr.select(behind, stretch.stop, stretch.start) - c)
    low = dr.select((k != 0) & (behind == (c < border)), near, 0)
    high = dr.fmax(dr.select(k == 0, near, end), low)
    weight, middle = high - low, (high + low) / 2
    u, v = dr.sqrt(low), dr.sqrt(high)
    if derivative:
        root = (u + v) / 2
    else:
        root = (u * u + u * v + v * v) / dr.select(v > 0, u + v, 1) * (2 / 3)
    distance = dr.select(behind == stretch.rooted, root * root, middle)
    sign = dr.select(behind, 1, -1)
    along, in_b = c + sign * distance, c + sign * middle > half
    x, y = stretch.x + dr.select(stretch.vertical, 0, along), stretch.y + dr.select(stretch.vertical, along, 0)
    return x, y, dr.select(in_b, 0, weight * stretch.weight_a), dr.select(in_b, weight * stretch.weight_b, 0)
