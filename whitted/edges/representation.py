"""How well the derivative of a sample stands for the mean derivative of its cell.

The derivative of a sample is that of its whole cell only if radiance is nearly linear there. In
mirrors of mirrors, highlights and mirrored balls are narrower than a cell, and beside silhouettes
radiance changes like the square root of the distance. A sample on such a streak has a huge
derivative, of which little is left in the mean over the cell.

What is left of it can be told from the image. As a parameter moves the streak, the derivative is
the streak's velocity times the slope of radiance in the image. The mean slope over the cell is the
difference of the neighbours' radiance. So a sample counts for the part of its own slope that its
neighbours confirm. Where an edge is between a sample and a neighbour, all that is known is that
radiance cannot change by more than there is.
"""

from collections.abc import Sequence

import drjit as dr

from ..core.arrays import Array
from .labels import labels_differ
from .settings import MOST_CHANGE

# Radiance and label of a sample
Sample = tuple[Array, Array]


def representation(
    own: Sample,
    around: Sequence[tuple[Sample, Sample]],
    slopes: Sequence[Array],
    step: Array,
) -> Array:
    """The part, from 0 to 1, of a sample's derivative that stands for its cell.

    Args:
        own: the sample.
        around: its neighbours to the left and to the right, and those above and below.
        slopes: of its radiance in the image, to the right and down, per pixel.
        step: the distance of the neighbours.
    """
    most = dr.max(own[0]) * MOST_CHANGE / step
    confirmed, squared = type(most)(0), type(most)(0)
    for (before, behind), slope in zip(around, slopes, strict=True):
        confirmed += dr.dot(slope, _mean_slope(own, before, behind, slope, most, step))
        squared += dr.squared_norm(slope)
    # Beside a silhouette a slope may not be finite; then the part is 0
    return dr.select(squared == 0, 1, dr.fmin(dr.fmax(confirmed / squared, 0), 1))


def _mean_slope(
    own: Sample, before: Sample, behind: Sample, slope: Array, most: Array, step: Array
) -> Array:
    """The slope of radiance from the neighbour before to the one behind."""
    one, two = (~labels_differ(own[1], other[1]) for other in (before, behind))
    change = dr.select(two, behind[0], own[0]) - dr.select(one, before[0], own[0])
    change /= dr.select(one & two, 2 * step, step)
    limited = type(slope)(*(dr.copysign(dr.fmin(dr.abs(c), most), c) for c in slope))
    return dr.select(one | two, change, limited)
