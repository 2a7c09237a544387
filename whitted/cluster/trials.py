"""The tasks of a fit from many starts: the first steps from some starts; and the whole way from the
best of them.
"""

import math
import pickle
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..core.interrupts import holding
from ..inverse.coarse_to_fine import Plan, chosen, pyramid_of, starts_of, trial
from ..inverse.fit import solve
from ..inverse.loss import Objective
from ..inverse.problem import Problem, problem_of

# Starts of a task: the first steps from each are some tens of pictures
BATCH = 4
# The loss where the first steps from a start end, the numbers there, and how many steps they were
Trial = tuple[float, tuple[float, ...], int]


@dataclass(frozen=True)
class Trials:
    """What the tasks of a fit share."""

    scene: Any  # or views
    target: Any
    wrt: Any
    plan: Plan
    options: dict[str, Any]  # of `problem_of`

    # Computed once in each process
    @cached_property
    def problem(self) -> Problem:
        return problem_of(self.scene, self.target, self.wrt, **self.options)

    @cached_property
    def coarsest(self) -> Objective:
        return pyramid_of(self.problem.objective, self.plan.levels)[0]

    @cached_property
    def starts(self) -> list[np.ndarray]:
        """All starts, the same in every process."""
        search = self.problem.search(lambda step: None)
        return starts_of(search, self.problem.start, self.plan)

    @property
    def tasks(self) -> int:
        return -(-self.plan.starts // BATCH)

    def to_send(self) -> "Trials":
        """The same without what has been computed."""
        return replace(self)


@holding
def try_starts(trials: Trials, task: int) -> list[Trial]:
    """Where the first steps from a task's starts lead."""
    method, found = chosen(trials.plan.method, trials.problem.objective), []
    for start in trials.starts[task * BATCH : (task + 1) * BATCH]:
        search = trials.problem.search(lambda step: None)
        try:
            loss, end = trial(search, trials.coarsest, start, method)
        except ValueError:
            # A start may leave what is finite
            loss, end = math.inf, start
        found.append((loss, tuple(end.tolist()), search.steps))
    return found


@holding
def go_on(trials: Trials, x: tuple[float, ...]) -> bytes:
    """The whole way from some numbers: a pickled result.

    Dask would open a result in a thread of its own, beside ours.
    """
    plan = replace(trials.plan, starts=1)
    _, result = solve(trials.problem, plan, np.array(x), lambda step: None)
    return pickle.dumps(result)
