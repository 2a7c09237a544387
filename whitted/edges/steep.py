"""Samples whose derivatives stand for less than their cells.

The derivative of a sample is that of its whole cell only if radiance is nearly linear there. In
mirrors of mirrors, highlights and mirrored balls are narrower than a cell. A sample on such a
streak has a huge derivative, of which next to nothing is left in the mean over the cell: radiance
cannot change by more than there is. So a sample counts for less, the more its radiance would change
over its cell.
"""

from dataclasses import replace

import numpy as np

from ..core.host import chunks, stacked
from ..sampling.band import Band
from . import kernels
from .quadrature import Extra
from .settings import SAMPLES, STEEP, STEP_ASIDE
from .tables import rows_of


def attenuated(band: Band, extra: Extra, brightness: np.ndarray) -> Extra:
    """The samples with less weight where radiance is steep.

    Args:
        brightness: of each pixel of the band.
    """
    step = STEP_ASIDE[band.structure.precision.name]
    factors = [np.ones(0)]
    for part in chunks(len(extra.x), SAMPLES):
        some = rows_of(extra, np.arange(part.start, part.stop))
        here, label = _traced(band, some.x, some.y)
        most = np.maximum(here.max(0), brightness.take(some.pixel))
        squared = np.zeros(len(most))
        for x, y in ((some.x + step, some.y), (some.x, some.y + step)):
            there, beside = _traced(band, x, y)
            change = np.abs(there - here).max(0) * (some.width / step)
            # An edge in between has a term of its own
            squared += np.where(label == beside, change, 0) ** 2
        factors.append(np.minimum(1, STEEP * most / np.maximum(np.sqrt(squared), 1e-30)))
    return replace(extra, weight=extra.weight * np.concatenate(factors))


def _traced(band: Band, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radiance (3, N) and labels at image positions."""
    color, label = kernels.labelled_samples(*band.inputs, *band.lanes(x, y))
    count = slice(len(x))
    return stacked([channel.numpy() for channel in color], count), label.numpy()[count]
