"""`fit`: recover a scene's parameters from pictures of it, by least squares over pixels.

Up to a hundred numbers are fitted by Levenberg and Marquardt's method, on Jacobians from forward
mode. More are fitted by Adam, on gradients from reverse mode. Pictures go from coarse to fine.

Source of the gain: G. Golub, V. Pereyra, "The Differentiation of Pseudo-Inverses and Nonlinear
Least Squares" (1973).
"""

import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from typing import Any

import numpy as np

from ..core.interrupts import forget, holding, insist, interruptible
from ..scene.scene import Scene
from .bounds import Bounds
from .coarse_to_fine import Plan, coarse_to_fine
from .convergence import Iteration, progress_bar
from .loss import Objective
from .priors import Priors
from .problem import Problem, problem_of
from .quality import assess
from .result import FitResult
from .search import Search
from .uncertainty import uncertainty

# Why a fit stopped, after Ctrl-C
INTERRUPTED = "interrupted"
# For further tries
SECONDS = 30.0


@holding
def fit(
    scene: Scene | Sequence[tuple[Any, ...]],
    target: object = None,
    *,
    wrt: Sequence[str],
    method: str = "auto",
    spp: int = 4,
    iterations: int | None = None,
    levels: int | None = None,
    starts: int = 1,
    seed: int = 0,
    budget: float | None = SECONDS,
    bounds: Bounds | None = None,
    mask: object = None,
    gain: bool = False,
    priors: Priors | None = None,
    robust: str | None = None,
    boundary: bool = True,
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    tolerance: float = 1e-6,
    progress: bool = True,
    callback: Callable[[Iteration], None] | None = None,
) -> FitResult:
    """Change a scene's parameters until its picture is the target.

    Args:
        scene: where to start. For several views: a list of pairs (scene, target), or triples
            with a mask. The views share the parameters, and each counts for as much as it has
            pixels.
        target: linear RGB of shape (height, width, 3), as `read_image` gives it; not integers.
        wrt: names of the parameters to fit, up to 1000 numbers, as in `Scene.parameters`; `*`
            stands for any part of a name.
        method: "lm" (Levenberg-Marquardt), "adam", or "auto", which takes "lm" for up to 100
            numbers, and for up to 16 if all derivatives of all pixels take more than half a GiB.
        spp: samples a pixel, a perfect square.
        iterations: at each resolution, at most [default: 40 for "lm", 200 for "adam"].
        levels: number of resolutions, each half the next [default: as many as leave 24 pixels along
            the shorter side].
        starts: number of starts. The first is the scene's. The others are drawn at random within
            the bounds, or around the first where those are open. All are tried at the coarsest
            resolution, and the best goes on.
        seed: of that draw, and of further tries.
        budget: seconds for further tries, where the pictures do not explain the target: numbers are
            moved at random, and the best moves go downhill. All descents, the first one too, end
            after 1.7 times the budget, not counting `starts`; then `stopped` says "budget used up".
            None: no further tries, and the descent takes as long as it does.
        bounds: name to (lowest, highest), None where open [default: what is legal; for an index of
            refraction at least 1].
        mask: what each pixel counts for, >= 0, or whether it counts, of shape (height, width).
        gain: fit a factor for each channel of each view as well, for targets of unknown exposure.
        priors: name to (mean, sigma) of what is known before, each a number or one for each
            component. The noise of the target tells how much it weighs.
        robust: "huber" or "cauchy", for targets with things that the scene lacks: large residuals
            count less than their squares, with "cauchy" hardly at all. Not with gain.
        boundary, max_depth: as of `render`. With boundary=False only samples are differentiated,
            which fails at edges.
        resolution: width and height of the target, in place of the scene's.
        tolerance: an "lm" fit ends when a step is below this part of each number's scale, or as
            short as a few of the numbers' standard errors.
        progress: show a bar on standard error, if that is a terminal.
        callback: called after each iteration.

    Returns:
        The result; `quality` says whether it explains the target. Ctrl-C ends the fit and gives the
        best so far, and `stopped` says "interrupted"; a second one, while that result is being
        made, raises `KeyboardInterrupt`.

    Raises:
        TypeError: neither a scene nor views, but the name of a scene, say.
        KeyError: a name that a scene does not have, or bounds or priors for a name that is not
            fitted.
        ValueError: another argument is out of range, a target does not fit the scene, or a number
            ceases to be finite; the message has the parameter and the iteration.

    Example:
        >>> ior = "materials.glass.ior"
        >>> found = whitted.fit(scene, picture, wrt=[ior, "spheres.ball.center"])
        >>> found.parameters[ior], found.uncertainty[ior]
    """
    if callable(progress):
        raise ValueError("progress: expected True or False; give a function as callback")
    plan = Plan(method, iterations, levels, starts, seed, budget)
    problem = problem_of(
        scene,
        target,
        wrt,
        spp=spp,
        bounds=bounds,
        mask=mask,
        gain=gain,
        priors=priors,
        robust=robust,
        boundary=boundary,
        max_depth=max_depth,
        resolution=resolution,
        tolerance=tolerance,
    )
    labels = problem.objective.labels()
    with progress_bar(labels) if progress else nullcontext(lambda step: None) as show:

        def report(step: Iteration) -> None:
            show(step)
            if callback is not None:
                callback(step)

        search, result = solve(problem, plan, problem.start, report)
    _warn_of_unseen(search, result)
    return result


def solve(
    problem: Problem, plan: Plan, x: np.ndarray, report: Callable[[Iteration], None]
) -> tuple[Search, FitResult]:
    """The search, and its result; after Ctrl-C the best so far.

    Args:
        x: where to start.
        report: called after each iteration.
    """
    search, stopped = problem.search(report), INTERRUPTED
    try:
        x, stopped = interruptible(coarse_to_fine, search, problem.objective, x, plan)
    except KeyboardInterrupt:
        x = search.best(x)
    return search, result_at(problem, search, x, stopped)


def result_at(problem: Problem, search: Search, x: np.ndarray, stopped: str) -> FitResult:
    """The result of a search that has ended at some numbers, for a reason."""
    make = partial(_result, search, problem.objective, x, stopped)
    result, interrupted = insist(make, stopped == INTERRUPTED)
    if interrupted or forget():
        result.stopped = INTERRUPTED
    return result


def _warn_of_unseen(search: Search, result: FitResult) -> None:
    """Name the parameters on which no picture depended."""
    for k in _unseen(search, result.covariance):
        message = f"fit: the pictures do not depend on {search.labels[k]}; it stays as it was"
        # Where `fit` was called: its frames begin with those of `holding`
        warnings.warn(message, UserWarning, stacklevel=6)


def _unseen(search: Search, covariance: np.ndarray) -> np.ndarray:
    """Which numbers have changed no picture."""
    return np.flatnonzero(~search.has_slope & np.isinf(covariance.diagonal()))


def _result(search: Search, objective: Objective, x: np.ndarray, stopped: str) -> FitResult:
    known, loss = uncertainty(objective, x, search.scale), objective.loss(x)
    if not search.history:
        size = objective.views[0].resolution
        search.history.append(Iteration(search.steps, size, loss, x.copy()))
    parameters = objective.parameters(x)
    unseen = [search.labels[k] for k in _unseen(search, known.covariance)]
    return FitResult(
        scene=objective.views[0].scene.replace(parameters),
        parameters=parameters,
        uncertainty=objective.parameters(np.sqrt(known.covariance.diagonal())),
        covariance=known.covariance,
        labels=search.labels,
        loss=loss,
        quality=assess(objective, x, unseen, known.weak),
        gains=objective.gains(x),
        history=search.history,
        stopped=stopped,
        notes=search.notes,
    )
