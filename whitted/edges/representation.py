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

from collections.abc import Callable, Sequence

import drjit as dr

from ..core.arrays import Array
from .labels import labels_differ
from .settings import MOST_CHANGE, STEP_ASIDE

# Radiance and label of a sample
Sample = tuple[Array, Array]


def representation(
    own: Sample,
    around: Sequence[tuple[Sample, Sample]],
    aside: Callable[[float, float], Sample],
    step: Array,
) -> Array:
    """The part, from 0 to 1, of a sample's derivative that stands for its cell.

    Args:
        own: the sample.
        around: its neighbours to the left and to the right, and those above and below.
        aside: traces a sample at a distance from this one.
        step: the distance of the neighbours.
    """
    most = dr.max(own[0]) * MOST_CHANGE / step
    confirmed, squared = type(most)(0), type(most)(0)
    known = dr.mask_t(most)(False)
    ways = (STEP_ASIDE, 0), (0, STEP_ASIDE)
    for (before, behind), way in zip(around, ways, strict=True):
        color, label = aside(*way)
        smooth = ~labels_differ(label, own[1])
        slope = dr.select(smooth, (color - own[0]) / STEP_ASIDE, 0)
        known |= smooth
        confirmed += dr.dot(slope, _mean_slope(own, before, behind, slope, most, step))
        squared += dr.squared_norm(slope)
    part = dr.select(squared > 0, dr.fmin(dr.fmax(confirmed / squared, 0), 1), 1)
    # So close to an edge that its own slope is not known
    return dr.select(known, part, 0)


def _mean_slope(
    own: Sample, before: Sample, behind: Sample, slope: Array, most: Array, step: Array
) -> Array:
    """The slope of radiance from the neighbour before to the one behind."""
    one, two = (~labels_differ(own[1], other[1]) for other in (before, behind))
    change = dr.select(two, behind[0], own[0]) - dr.select(one, before[0], own[0])
    change /= dr.select(one & two, 2 * step, step)
    limited = type(slope)(*(dr.copysign(dr.fmin(dr.abs(c), most), c) for c in slope))
    return dr.select(one | two, change, limited)
