"""The kernels of `lattice.py`, each of which has one lane for each pixel."""

import drjit as dr
import numpy as np

from ..core.arrays import Array, Parameters
from ..core.frozen import frozen
from ..sampling.differentiated import prepare
from ..sampling.points import in_lanes
from ..scene.structure import Structure
from ..tracing.node import Limits
from ..tracing.record import Record
from . import settings
from .kernels import slopes_at
from .labels import labels_differ
from .representation import Sample, representation
from .slopes import Shot

# The place of a pixel's sample in the middle, and those of the others; see `lattice.py`
MIDDLE, AROUND = 4, (0, 1, 2, 3, 5, 6, 7, 8)
# The samples at the ends of lines between neighbours: on the upper side, the left one, inside, and
# on the lower side and the right one
LINES = np.array(
    [(0, 1), (1, 2), (0, 3), (3, 6), (3, 4), (4, 5), (1, 4), (4, 7), (6, 7), (7, 8), (2, 5), (5, 8)]
)
# The weights of the samples in the trapezoid rule
WEIGHTS = (1 / 16, 1 / 8, 1 / 16, 1 / 8, 1 / 4, 1 / 8, 1 / 16, 1 / 8, 1 / 16)
# For each of the samples around the middle, where it is among those that were traced
Slots = tuple[Array, ...]


def _nine(middle: Sample, color: Array, label: Array, slots: Slots) -> list[Sample]:
    """The pixels' samples."""
    nine = [(dr.gather(type(color), color, k), dr.gather(type(label), label, k)) for k in slots]
    nine.insert(MIDDLE, middle)
    return nine


@frozen
def means(middle: Array, own: Array, color: Array, label: Array, slots: Slots) -> Array:
    """The pixels' radiance.

    Args:
        middle, own: radiance and labels of the samples in the middles.
        color, label: of the samples that were traced.
    """
    nine = _nine((middle, own), color, label, slots)
    return sum(seen * weight for (seen, _), weight in zip(nine, WEIGHTS, strict=True))


@frozen
def contrasts(
    middle: Array,
    own: Array,
    color: Array,
    label: Array,
    slots: Slots,
) -> tuple[Array, ...]:
    """For each of `LINES`, the contrast of the edge there; 0 for none, and for one that is too
    faint to matter.

    It is the greatest change of a channel, as a part of the greater radiance.
    """
    nine = _nine((middle, own), color, label, slots)

    def contrast(a: Sample, b: Sample) -> Array:
        change = dr.max(dr.abs(a[0] - b[0]))
        most = dr.fmax(dr.max(a[0]), dr.max(b[0]))
        seen = labels_differ(a[1], b[1]) & (change > settings.LEAST_CONTRAST * most)
        return dr.select(seen, change, 0)

    return tuple(contrast(nine[a], nine[b]) for a, b in LINES)


@frozen
def represented(
    structure: Structure,
    parameters: Parameters,
    size: Array,
    limits: Limits,
    x: Array,
    y: Array,
    middle: Array,
    own: Array,
    color: Array,
    label: Array,
    slots: Slots,
    number: Array,
    record: Record | None,
) -> Array:
    """How well the derivatives of the samples in the middles stand for their pixels, as
    `representation` says.

    Args:
        number: of each of these samples in the record.
    """
    shot = Shot(*prepare(structure, parameters, size), size, limits)
    _, above, _, left, at, right, _, below, _ = _nine((middle, own), color, label, slots)
    hits = None if record is None else record.hits(number)
    slopes = slopes_at(shot, x, y, hits)
    around = [(left, right), (above, below)]
    return in_lanes(x, representation(at, around, slopes, type(x)(0.5)))
