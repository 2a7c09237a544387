"""The order of a fit: several starts at the coarsest resolution, then one resolution after another.

Where a descent ends and the pictures are not explained, further tries follow (`explore.py`).

A picture at half the resolution is blurred by a pixel twice as wide. An edge acts from twice as far
in it. So a coarse fit finds what a fine one would miss, and a fine one tells what a coarse one
cannot.
"""

import math
import time
from dataclasses import dataclass

import numpy as np

from .adam import adam
from .explore import Explorer
from .levenberg_marquardt import levenberg_marquardt
from .loss import Objective
from .moves import Moves
from .quality import assess
from .search import LATE, Search

DESCENTS = {"lm": levenberg_marquardt, "adam": adam}
METHODS = ("auto", *DESCENTS)
# Up to this many numbers, second-order steps cost less than the many first-order ones that they
# replace. With 60, they take 5 s instead of 8 s (`benchmarks/recovery.py many`); that grows with
# the number. From FEW on they also need memory: so many derivatives of pixels take half a GiB
MANY, FEW, DERIVATIVES = 100, 16, 1 << 26
# A picture is not halved to fewer pixels along its shorter side
COARSEST = 24
# Iterations at each resolution
ITERATIONS = {"lm": 40, "adam": 200}
# A further start is drawn from the bounds. Where they are open, it is drawn from so many times the
# scale of each number around the first start
SPREAD = 4.0
# Iterations by which starts are compared
TRIALS = {"lm": 8, "adam": 40}
# Further tries at a coarse resolution leave a part of the budget to finer ones
SHARE = 0.8
# Descents end after so many times the budget. With the default of 30 s, that leaves 9 s of a minute
# to the step that has begun, and to the error bars
LONGEST = 1.7


@dataclass(frozen=True)
class Plan:
    """How a fit goes about it; None where the fit chooses."""

    method: str
    iterations: int | None  # at each resolution, at most
    levels: int | None  # resolutions, each half the next
    starts: int
    seed: int
    budget: float | None = None  # seconds for further tries; None: no further ones

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            expected = ", ".join(METHODS)
            raise ValueError(f"method: expected one of {expected}, got {self.method!r}")
        for name in ("iterations", "levels", "starts"):
            value = getattr(self, name)
            if value is not None and (not isinstance(value, int) or value < 1):
                raise ValueError(f"{name}: expected a whole number from 1 on, got {value!r}")
        if not isinstance(self.seed, (int, np.integer)) or self.seed < 0:
            raise ValueError(f"seed: expected a whole number from 0 on, got {self.seed!r}")
        seconds = self.budget
        if seconds is not None and not (
            isinstance(seconds, (int, float)) and 0 < seconds < math.inf
        ):
            raise ValueError(
                "budget: expected a number of seconds > 0, or None for a single try, "
                f"got {seconds!r}"
            )


def coarse_to_fine(
    search: Search, objective: Objective, x: np.ndarray, plan: Plan
) -> tuple[np.ndarray, str]:
    """The numbers that fit, and why the search ended.

    Args:
        x: where to start.

    Raises:
        ValueError: more levels than the pictures' pixels allow.
    """
    method = chosen(plan.method, objective)
    descend, iterations = DESCENTS[method], plan.iterations or ITERATIONS[method]
    pyramid = pyramid_of(objective, plan.levels)
    if plan.starts > 1:
        x = _best_end(search, pyramid[0], starts_of(search, x, plan), method)
    tries = TRIALS[method], iterations
    seconds, begin, random = plan.budget or 0.0, x, np.random.default_rng(plan.seed)
    if plan.budget is not None:
        search.deadline = time.monotonic() + LONGEST * plan.budget
    for k, one in enumerate(pyramid):
        level = len(pyramid) - 1 - k
        x, stopped = descend(search, one, x, iterations, level)
        doubtful = k == 0 and objective.robust is not None
        if seconds > 0 and not search.late and (doubtful or not assess(one, x).explained):
            since = time.monotonic()
            moves = Moves(search, one, begin, random)
            explorer = Explorer(search, one, descend, tries, level, moves, coarsest=k == 0)
            x, stopped = explorer.run(x, stopped, seconds * SHARE if level else seconds)
            seconds -= time.monotonic() - since
    if search.late and stopped == LATE:
        search.notes.append(f"the descent was ended after {LONGEST:g} times the budget; give more")
    return x, stopped


def _best_end(
    search: Search, coarsest: Objective, starts: list[np.ndarray], method: str
) -> np.ndarray:
    """Where the first steps from the best of some starts lead."""
    ends: list[tuple[float, np.ndarray]] = []
    try:
        for start in starts:
            ends.append(trial(search, coarsest, start, method))
    except KeyboardInterrupt:
        search.notes.append(starts_tried(len(ends), len(starts)))
        raise
    return min(ends, key=lambda pair: pair[0])[1]


def starts_tried(count: int, of: int) -> str:
    """What a fit says that was interrupted among its starts."""
    return f"{count} of {of} starts were tried"


def trial(
    search: Search, coarsest: Objective, start: np.ndarray, method: str
) -> tuple[float, np.ndarray]:
    """Where the first steps from a start lead: the loss there, and the numbers."""
    end, _ = DESCENTS[method](search, coarsest, start, TRIALS[method], 0)
    return coarsest.loss(end), end


def chosen(method: str, objective: Objective) -> str:
    """The method of descent, where "auto" chooses by the number of parameters and of pixels."""
    if method != "auto":
        return method
    fits = objective.count * 3 * sum(view.weight.size for view in objective.views) <= DERIVATIVES
    return "lm" if objective.count <= FEW or (objective.count <= MANY and fits) else "adam"


def pyramid_of(objective: Objective, levels: int | None) -> list[Objective]:
    """The objective at so many resolutions, the coarsest first."""
    smallest = min(min(view.resolution) for view in objective.views)
    if levels is None:
        levels = 1 + max(0, int(math.log2(smallest / COARSEST)))
    if smallest < 1 << (levels - 1):
        raise ValueError(f"levels: {levels} halvings leave nothing of {smallest} pixels")
    pyramid = [objective]
    for _ in range(levels - 1):
        pyramid.insert(0, pyramid[0].halved())
    return pyramid


def starts_of(search: Search, x: np.ndarray, plan: Plan) -> list[np.ndarray]:
    """The first start, and others drawn at random."""
    random = np.random.default_rng(plan.seed)
    closed = np.isfinite(search.low) & np.isfinite(search.high)
    low = np.where(closed, search.low, np.maximum(search.low, x - SPREAD * search.scale))
    high = np.where(closed, search.high, np.minimum(search.high, x + SPREAD * search.scale))
    return [x, *(random.uniform(low, high) for _ in range(plan.starts - 1))]
