"""`fit`: a fit from many starts."""

import math
import pickle
from collections.abc import Callable, Sequence
from contextlib import closing
from typing import Any

import numpy as np

from ..files.progress import reporting
from ..inverse.coarse_to_fine import Plan, starts_tried
from ..inverse.fit import INTERRUPTED, SECONDS, result_at
from ..inverse.result import FitResult
from ..rendering.samples import check_depth, checked_side
from ..scene.scene import Scene
from .engine import outcomes
from .plan import is_whole
from .trials import Trial, Trials, go_on, try_starts

# Further options, those of `whitted.fit`
OPTIONS = (
    "spp",
    "bounds",
    "mask",
    "gain",
    "priors",
    "robust",
    "boundary",
    "max_depth",
    "resolution",
    "tolerance",
)
# Ends of first steps that are closer than this part of each number's scale are one
ALIKE = 0.02


def fit(
    scene: Scene | Sequence[tuple[Any, ...]],
    target: object = None,
    client: Any = None,
    *,
    wrt: Sequence[str],
    starts: int = 1000,
    best: int = 4,
    method: str = "auto",
    iterations: int | None = None,
    levels: int | None = None,
    seed: int = 0,
    budget: float | None = SECONDS,
    progress: Callable[[float], None] | bool | None = None,
    **options: Any,
) -> FitResult:
    """Fit a scene to its picture from many starts.

    The first steps from each start are taken at the coarsest resolution, on all workers. The best
    few ends go on, each as `whitted.fit` does, and the lowest loss wins.

    Args:
        scene, target, wrt, method, iterations, levels, seed: as of `whitted.fit`.
        client: a `distributed.Client`; None: this process does all.
        starts: how many. They are those of `whitted.fit`: the first is the scene's.
        best: how many ends go on.
        budget: as of `whitted.fit`, for each that goes on.
        progress: called with the fraction done; True shows a bar on standard error.
        options: further ones of `whitted.fit`: spp, bounds, mask, gain, priors, robust, boundary,
            max_depth, resolution, tolerance.

    Returns:
        The result. Ctrl-C gives the best so far, whose `stopped` says "interrupted".

    Raises:
        KeyError, TypeError, ValueError: as `whitted.fit`.
        RuntimeError: every task has failed three times.
        ConnectionError: the scheduler has gone.

    Example:
        >>> found = cluster.fit(scene, picture, client, wrt=["spheres.ball.center"], starts=1000)
    """
    for name, value in (("starts", starts), ("best", best)):
        if not is_whole(value) or value < 1:
            raise ValueError(f"{name}: expected a whole number from 1 on, got {value!r}")
    for name in options:
        if name not in OPTIONS:
            raise TypeError(f"fit: has no option {name!r}; further ones are {', '.join(OPTIONS)}")
    plan = Plan(method, iterations, levels, int(starts), seed, budget)
    trials = Trials(scene, target, wrt, plan, options)
    # Find out here what is wrong with it, before workers do
    checked_side(options.get("spp", 1))
    check_depth(options.get("max_depth"))
    _ = trials.starts, trials.coarsest
    with reporting(progress, "fitting") as report:
        return _Contest(client, trials, best, report or (lambda fraction: None)).run()


class _Contest:
    """The starts, the ends of their first steps, and the results of those that went on."""

    def __init__(
        self, client: Any, trials: Trials, best: int, report: Callable[[float], None]
    ) -> None:
        self.client, self.trials, self.best, self.report = client, trials, best, report
        self.ends: list[Trial] = []
        self.results: list[FitResult] = []
        self.done = 0

    def run(self) -> FitResult:
        """The best result; after Ctrl-C, the best so far."""
        try:
            for value in self._values(try_starts, range(self.trials.tasks)):
                self.ends += value
            for value in self._values(go_on, self._best_ends()):
                self.results.append(pickle.loads(value))
        except KeyboardInterrupt:
            return self._so_far()
        return min(self.results, key=lambda result: result.loss)

    def _values(self, function: Callable[..., Any], tasks: Sequence[Any]) -> Any:
        """What tasks return; a task that fails is left out, unless all do."""
        reason, values = "", 0
        with closing(outcomes(self.client, function, self.trials.to_send(), tasks)) as run:
            for outcome in run:
                self.done += 1
                self.report(min(1.0, self.done / (self.trials.tasks + self.best)))
                if outcome.error is None:
                    values += 1
                    yield outcome.value
                else:
                    reason = outcome.error
        if not values:
            raise RuntimeError(f"fit: all tasks have failed three times: {reason}")

    def _best_ends(self) -> list[tuple[float, ...]]:
        """The best ends of first steps, of which no two are alike."""
        chosen: list[tuple[float, ...]] = []
        for loss, end, _ in sorted(self.ends):
            scales = self.trials.problem.scales
            far = [abs(np.subtract(end, one) / scales).max() > ALIKE for one in chosen]
            if all(far) and (math.isfinite(loss) or not chosen):
                chosen.append(end)
        return chosen[: self.best]

    def _so_far(self) -> FitResult:
        """The best so far, without further steps."""
        if self.results:
            result = min(self.results, key=lambda result: result.loss)
            result.stopped = INTERRUPTED
            return result
        problem = self.trials.problem
        x = np.array(min(self.ends)[1]) if self.ends else problem.start
        search = problem.search(lambda step: None)
        search.steps = sum(steps for _, _, steps in self.ends)
        search.notes.append(starts_tried(len(self.ends), self.trials.plan.starts))
        return result_at(problem, search, x, INTERRUPTED)
