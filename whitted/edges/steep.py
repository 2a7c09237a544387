"""Samples whose derivatives stand for less than their cells.

The derivative of a sample is that of its whole cell only if radiance is nearly linear there. In
mirrors of mirrors, highlights and mirrored balls are narrower than a cell. A sample on such a
streak has a huge derivative, of which next to nothing is left in the mean over the cell: radiance
cannot change by more than there is. So a sample counts for less, the more its radiance would change
over its cell. With one sample a pixel, a sample in a sliver between two edges does not count at
all.
"""

from dataclasses import replace

import numpy as np

from ..core.host import chunks, stacked, to_numpy
from ..sampling.band import Band
from . import kernels
from .bounds import numbers_of
from .quadrature import Extra
from .settings import SAMPLES, SLIVER, STEEP, STEP_ASIDE
from .tables import rows_of


def attenuated(band: Band, extra: Extra, image: np.ndarray) -> Extra:
    """The samples with less weight where radiance is steep.

    Args:
        image: the band's pixels, flat.
    """
    factors = [np.ones(0)]
    for part in chunks(len(extra.x), SAMPLES // 4):
        some = rows_of(extra, np.arange(part.start, part.stop))
        x = some.x + np.array([-STEP_ASIDE, STEP_ASIDE, 0, 0])[:, None]
        y = some.y + np.array([0, 0, -STEP_ASIDE, STEP_ASIDE])[:, None]
        color, label = _traced(band, x, y)
        # An edge in between has a term of its own
        smooth, size = label[::2] == label[1::2], np.stack([some.width, some.height])
        change = np.where(smooth, np.abs(color[:, ::2] - color[:, 1::2]).max(0), 0)
        change *= size / (2 * STEP_ASIDE)
        most = np.maximum(numbers_of(image, some.pixel).max(0), color.max((0, 1)))
        factor = np.minimum(1, STEEP * most / np.maximum(np.hypot(*change), 1e-30))
        if band.side == 1:
            # So close an edge in so large a cell: the sample is in a sliver
            factor[(~smooth & (size > SLIVER * STEP_ASIDE)).any(0)] = 0
        factors.append(factor)
    return replace(extra, weight=extra.weight * np.concatenate(factors))


def _traced(band: Band, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radiance (3, ...) and labels (...) at image positions."""
    color, label = kernels.labelled_samples(*band.inputs, *band.lanes(x.ravel(), y.ravel()))
    channels = stacked(to_numpy(color), slice(x.size))
    return channels.reshape(3, *x.shape), label.numpy()[: x.size].reshape(x.shape)
