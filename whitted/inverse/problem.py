"""What is to be fitted: pictures, the numbers that they depend on, bounds, and where to start."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..scene.scene import Scene
from .bounds import Bounds, bounds_of, scales_of, shapes_of, start_of
from .convergence import Iteration
from .loss import Objective
from .priors import Priors, prior_of
from .robust import check_robust
from .search import Search
from .views import views_of

# Numbers that are fitted at once, at most: error bars take a derivative of the pictures for each
MOST = 1000
# A step shorter than this, in standard errors, changes next to nothing of what the pictures tell
LEAST_ERRORS = 0.1


@dataclass(frozen=True)
class Problem:
    """What is to be fitted."""

    objective: Objective
    low: np.ndarray
    high: np.ndarray
    scales: np.ndarray
    start: np.ndarray
    tolerance: float

    def search(self, report: Callable[[Iteration], None]) -> Search:
        """A search that has not begun."""
        labels = self.objective.labels()
        ends = self.tolerance, LEAST_ERRORS
        return Search(self.low, self.high, self.scales, *ends, labels, report)


def problem_of(
    scene: Scene | Sequence[tuple[Any, ...]],
    target: object,
    wrt: Sequence[str],
    *,
    spp: int = 4,
    bounds: Bounds | None = None,
    mask: object = None,
    gain: bool = False,
    priors: Priors | None = None,
    robust: str | None = None,
    boundary: bool = True,
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    tolerance: float = 1e-6,
) -> Problem:
    """What a user asks for; the arguments and the errors of `fit`."""
    given = _names(wrt)
    views = views_of(scene, target, mask, resolution)
    first = views[0].scene
    names = list(first.parameters(*given))
    for one in views:
        one.scene.parameters(*names)
    x = np.concatenate([start_of(first, name) for name in names])
    if not 0 < x.size <= MOST:
        remedy = "an optimiser of drjit.opt takes any number, as in examples/beads.py"
        raise ValueError(f"wrt: expected from 1 to {MOST} numbers, got {x.size}; {remedy}")
    options = {"spp": spp, "boundary": boundary, "max_depth": max_depth}
    check_robust(robust, gain)
    prior = prior_of(first, names, {} if priors is None else priors)
    objective = Objective(
        tuple(views), tuple(names), shapes_of(first, names), options, gain, prior, robust
    )
    low, high = bounds_of(first, names, bounds or {})
    return Problem(objective, low, high, scales_of(first, names), x, tolerance)


def _names(wrt: Sequence[str]) -> list[str]:
    names = [wrt] if isinstance(wrt, str) else list(wrt)
    if not names:
        raise ValueError(
            "wrt: expected names of parameters, got an empty list; Scene.parameters() has them all"
        )
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ValueError(f"wrt: '{repeated[0]}' is named twice")
    return names
