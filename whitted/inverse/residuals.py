"""What is left of the pictures at the end of a fit, and what finitely many samples leave."""

from dataclasses import dataclass, replace

import numpy as np

from .loss import Objective
from .robust import left_out


@dataclass(frozen=True)
class Residuals:
    """The residuals of all views, each of shape (height, width, 3), as far as pixels count.

    Among pixels that count for different amounts, those that count for most have all of theirs.
    What a robust loss leaves out has none.
    """

    left: list[np.ndarray]  # the pictures less the targets
    samples: list[np.ndarray]  # what plain samples would change in that
    share: float  # of the pixels that a robust loss leaves out


def residuals_of(objective: Objective, x: np.ndarray) -> Residuals:
    """The residuals at some numbers.

    Plain samples are as many as the fit's. Where the fit has plain samples itself, its pictures are
    held against such with four times as many.
    """
    own = objective.residuals(x)
    plain = {**objective.options, "boundary": False}
    if not objective.options["boundary"]:
        plain["spp"] *= 4
    others = replace(objective, options=plain).residuals(x)
    left, samples, lost, count = [], [], 0, 0
    for view, residual, other in zip(objective.views, own, others, strict=True):
        used = view.weight > 0
        part = np.sqrt(view.weight / view.weight.max())
        if objective.robust is not None:
            ignored = left_out(objective.unusual_weight(view, residual))
            part = np.where(ignored, 0, part)
            lost += int((ignored & used).sum())
        count += int(used.sum())
        left.append(part * residual)
        samples.append(part * (other - residual))
    return Residuals(left, samples, lost / count)
