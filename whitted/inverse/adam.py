"""First-order steps, for many numbers.

Source: D. Kingma, J. Ba, "Adam: A Method for Stochastic Optimization" (2015).
"""

import math

import drjit as dr
import numpy as np
from drjit.opt import Adam

from .loss import Objective
from .search import NO_SLOPE, Search

# The first step in units of each number's scale, at the finest resolution, and the last one
# relative to it
STEP, LAST = 0.05, 0.05
# The search has converged when the loss of so many iterations is no better than before, by this
# part of it
PATIENCE, BETTER = 40, 1e-4


def adam(
    search: Search, objective: Objective, x: np.ndarray, iterations: int, level: int
) -> tuple[np.ndarray, str]:
    """Adam's steps, in units of each number's scale, which shrink to the end.

    Args:
        level: halvings of the pictures' resolution; coarse fits take larger steps.

    Returns:
        The best numbers, and why the search ended.
    """
    scene, sizes = objective.views[0].scene, objective.sizes
    start = objective.parameters(x)
    types = {name: type(value) for name, value in scene.parameters(*objective.names).items()}

    def arrays(values: dict) -> dict:
        return {name: types[name](*np.ravel(value).tolist()) for name, value in values.items()}

    optimiser = Adam(1.0, params=arrays(start))
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    best, before = (math.inf, x), 0
    for k in range(iterations):
        shrink = LAST ** (k / max(1, iterations - 1)) * 2.0**level * STEP
        rates = {
            name: shrink * float(search.scale[i]) for name, i in zip(start, first, strict=True)
        }
        optimiser.set_learning_rate(rates)
        values = dict(optimiser.items())
        loss = objective.gradient(values)
        slope = _flat([dr.grad(value) for value in values.values()])
        search.record(objective, loss, x, slope)
        if not slope.any() and best[0] == math.inf:
            return x, NO_SLOPE
        if loss < best[0] * (1 - BETTER):
            before = k
        if loss < best[0]:
            best = loss, x
        if k - before > PATIENCE:
            return best[1], "converged: the loss falls no further"
        optimiser.step()
        x = _flat(optimiser.values())
        inside = search.bounded(x)
        if (inside != x).any():
            x = inside
            for name, value in arrays(objective.parameters(x)).items():
                optimiser[name] = value
    return best[1], "iterations used up"


def _flat(values) -> np.ndarray:
    """All numbers of some arrays."""
    return np.concatenate([value.numpy().ravel() for value in values]).astype(np.float64)
