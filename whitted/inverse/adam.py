"""First-order steps, for many numbers.

Source: D. Kingma, J. Ba, "Adam: A Method for Stochastic Optimization" (2015).
"""

import math

import drjit as dr
import numpy as np
from drjit.opt import Adam

from .loss import Objective, arrays, numbers_in
from .search import LATE, NO_SLOPE, Search

# The first step at the finest resolution, in units of each number's scale, and the last step in
# units of the first
STEP, LAST = 0.05, 0.05
# The search has converged when PATIENCE iterations in a row have not lowered the loss by this part
PATIENCE, BETTER = 40, 1e-4


def adam(
    search: Search, objective: Objective, x: np.ndarray, iterations: int, level: int
) -> tuple[np.ndarray, str]:
    """Take Adam's steps. They are in units of each number's scale, and shrink towards the end.

    Args:
        level: how often the pictures' resolution is halved; coarse fits take larger steps.

    Returns:
        The best numbers, and why the search ended.
    """
    scene = objective.views[0].scene
    optimiser = Adam(1.0, params=arrays(scene, objective.parameters(x)))
    first = np.concatenate([[0], np.cumsum(objective.sizes)[:-1]])
    best, before = (math.inf, x), 0
    for k in range(iterations + 1):
        shrink = LAST ** (k / max(1, iterations - 1)) * 2.0**level * STEP
        scales = zip(objective.names, search.scale[first], strict=True)
        optimiser.set_learning_rate({name: shrink * float(scale) for name, scale in scales})
        values = dict(optimiser.items())
        loss = objective.gradient(values)
        slope = numbers_in(dr.grad(value) for value in values.values())
        search.record(objective, loss, x, slope)
        if not slope.any() and best[0] == math.inf:
            return x, NO_SLOPE
        if loss < best[0] * (1 - BETTER):
            before = k
        if loss < best[0]:
            best = loss, x
        if k - before > PATIENCE:
            return best[1], "converged: the loss falls no further"
        if search.late:
            return best[1], LATE
        if k == iterations:
            break
        optimiser.step()
        search.steps += 1
        x = numbers_in(optimiser.values())
        inside = search.bounded(x)
        if (inside != x).any():
            x = inside
            for name, value in arrays(scene, objective.parameters(x)).items():
                optimiser[name] = value
    return best[1], "iterations used up"
