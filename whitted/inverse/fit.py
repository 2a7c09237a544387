"""Recover a scene's parameters from pictures of it: least squares over pixels, from coarse pictures
to fine ones.

A handful of parameters is fitted by Levenberg and Marquardt's method on Jacobians from forward
mode, more by Adam on gradients from reverse mode. A picture at half the resolution is blurred by a
pixel twice as wide, in which an edge acts from twice as far, so that a coarse fit finds what a fine
one would miss, and a fine one what a coarse one cannot tell.

Source of the gain: G. Golub, V. Pereyra, "The Differentiation of Pseudo-Inverses and Nonlinear
Least Squares" (1973).
"""

import math
import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..scene.scene import Scene
from .adam import adam
from .bounds import Bounds, bounds_of, scales_of, start_of
from .convergence import Iteration, plot, progress_bar
from .levenberg_marquardt import levenberg_marquardt
from .loss import Objective, View, split, view
from .search import Search

METHODS = ("auto", "lm", "adam")
DESCENTS = {"lm": levenberg_marquardt, "adam": adam}
# Numbers up to which second-order steps cost less than the many first-order ones that they replace
FEW = 16
# A picture is not halved to fewer pixels along its shorter side
COARSEST = 24
# Iterations at each resolution
ITERATIONS = {"lm": 40, "adam": 200}
# A further start is drawn from the bounds, or where they are open from so many times the scale of
# each number around the first, and tried for so many iterations
SPREAD, TRIALS = 4.0, 8


@dataclass
class FitResult:
    """What a fit found."""

    scene: Scene  # the first view's, with the recovered parameters
    parameters: dict[str, Any]  # name to a number or three
    uncertainty: dict[
        str, Any
    ]  # the same for one standard deviation; infinite where the pictures do not tell
    covariance: np.ndarray  # of all numbers, in the order of `labels`
    labels: list[str]
    loss: float  # half the mean square of the residuals, at the full resolution
    gains: np.ndarray  # (views, 3)
    history: list[Iteration]
    stopped: str  # why
    notes: list[str] = field(default_factory=list)

    def named(self, x: np.ndarray) -> dict[str, Any]:
        """The parameters at an iteration's numbers, for `Scene.replace`."""
        return split(self.parameters, x)

    def numbers(self) -> list[tuple[str, float, float]]:
        """A label, the value and one standard deviation of each number."""
        values = np.concatenate([np.ravel(value) for value in self.parameters.values()])
        return list(
            zip(
                self.labels,
                values.tolist(),
                np.sqrt(self.covariance.diagonal()).tolist(),
                strict=True,
            )
        )

    def plot(self, path: str | None = None) -> Any:
        """Draw the loss and each parameter over the iterations; needs the extra `fit`.

        Args:
            path: a file to write, by its ending.

        Returns:
            The matplotlib figure.
        """
        return plot(self.history, self.labels, path)


def fit(
    scene: Scene | Sequence[tuple],
    target: object = None,
    *,
    wrt: Sequence[str],
    method: str = "auto",
    spp: int = 4,
    iterations: int | None = None,
    levels: int | None = None,
    starts: int = 1,
    seed: int = 0,
    bounds: Bounds | None = None,
    mask: object = None,
    gain: bool = False,
    boundary: bool = True,
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    tolerance: float = 1e-6,
    progress: bool = True,
    callback: Callable[[Iteration], None] | None = None,
) -> FitResult:
    """Change a scene's parameters until its picture is the target.

    Args:
        scene: where to start; or several views as pairs (scene, target), or triples with a mask,
            which share the parameters. Their number of pixels decides what each counts for.
        target: linear RGB of shape (height, width, 3).
        wrt: names of parameters, as in `Scene.parameters`.
        method: "lm" (Levenberg-Marquardt), "adam", or "auto", which takes "lm" for up to 16
            numbers.
        spp: samples a pixel, a perfect square.
        iterations: at each resolution, at most [default: 40 for "lm", 200 for "adam"].
        levels: resolutions, each half the next [default: as many as leave 24 pixels along the
            shorter side].
        starts: places to start from: the scene's, and others drawn at random within the bounds, or
            around it where those are open. All are tried at the coarsest resolution, and the best
            goes on.
        seed: of that draw.
        bounds: name to (lowest, highest), None where open [default: what is legal, and an index of
            at least 1].
        mask: what each pixel counts for, >= 0, of shape (height, width).
        gain: each channel of a view may be brighter by a factor, which is fitted along: for targets
            of unknown exposure.
        boundary, max_depth: of `render`; boundary=False differentiates samples alone, and fails at
            edges.
        resolution: width and height of the target, in place of the scene's.
        tolerance: ends an "lm" fit when a step is below this part of each number's scale.
        progress: show a bar on a terminal's standard error.
        callback: called after each iteration.

    Returns:
        The result; Ctrl-C ends the fit and gives the best so far.

    Raises:
        KeyError: a name that a scene does not have, or bounds for a name that is not fitted.
        ValueError: another argument that is out of range, a target that does not fit the scene, or
            a number that ceases to be finite; the message has the parameter and the iteration.
    """
    names = _names(wrt)
    _check(method, iterations, levels, starts)
    views = _views(scene, target, mask, resolution)
    first = views[0].scene
    for one in views:
        one.scene.parameters(*names)
    x = np.concatenate([start_of(first, name) for name in names])
    sizes = tuple(start_of(first, name).size for name in names)
    options = {"spp": spp, "boundary": boundary, "max_depth": max_depth}
    objective = Objective(tuple(views), tuple(names), sizes, options, gain)
    chosen = method if method != "auto" else "lm" if objective.count <= FEW else "adam"
    low, high = bounds_of(first, names, bounds or {})

    with progress_bar(objective.labels()) if progress else nullcontext(lambda step: None) as show:

        def report(step: Iteration) -> None:
            show(step)
            if callback is not None:
                callback(step)

        search = Search(
            low,
            high,
            scales_of(first, names),
            tolerance,
            objective.labels(),
            report,
            has_slope=np.zeros(len(x), bool),
        )
        stopped = "interrupted"
        try:
            x, stopped = _coarse_to_fine(
                search, objective, x, chosen, iterations, levels, starts, seed
            )
        except KeyboardInterrupt:
            x = search.best(x)
        return _result(search, objective, x, stopped)


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


def _check(method: str, iterations: int | None, levels: int | None, starts: int) -> None:
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    for name, value in (("iterations", iterations), ("levels", levels), ("starts", starts)):
        if value is not None and (not isinstance(value, int) or value < 1):
            raise ValueError(f"{name}: expected a whole number from 1 on, got {value!r}")


def _views(
    scene: Scene | Sequence[tuple], target: object, mask: object, resolution: tuple[int, int] | None
) -> list[View]:
    if isinstance(scene, Scene):
        if target is None:
            raise ValueError("target: expected an image, got None")
        return [view(scene, target, mask, resolution, "")]
    if target is not None or mask is not None:
        raise ValueError(
            "target: with several views, give each as (scene, target) or (scene, target, mask)"
        )
    views = list(scene)
    if not views or not all(
        isinstance(one, tuple) and len(one) in (2, 3) and isinstance(one[0], Scene) for one in views
    ):
        raise ValueError("scene: expected a scene, or pairs (scene, target)")
    return [
        view(one[0], one[1], one[2] if len(one) == 3 else None, resolution, f"view {k}: ")
        for k, one in enumerate(views)
    ]


def _coarse_to_fine(
    search: Search,
    objective: Objective,
    x: np.ndarray,
    method: str,
    iterations: int | None,
    levels: int | None,
    starts: int,
    seed: int,
) -> tuple[np.ndarray, str]:
    """The numbers that fit, and why the search ended."""
    smallest = min(min(view.resolution) for view in objective.views)
    count = (
        levels or max(1, 1 + int(math.log2(smallest / COARSEST)))
        if smallest >= 2 * COARSEST
        else levels or 1
    )
    if smallest < 1 << (count - 1):
        raise ValueError(f"levels: {count} halvings leave nothing of {smallest} pixels")
    pyramid = [objective]
    for _ in range(count - 1):
        pyramid.insert(0, pyramid[0].halved())
    descend = DESCENTS[method]
    steps = iterations or ITERATIONS[method]
    if starts > 1:
        x = _best_start(search, pyramid[0], x, descend, starts, seed)
    for level, one in enumerate(pyramid):
        x, stopped = descend(search, one, x, steps, len(pyramid) - 1 - level)
    return x, stopped


def _best_start(
    search: Search, objective: Objective, x: np.ndarray, descend: Callable, starts: int, seed: int
) -> np.ndarray:
    """Of several starts the one from which a few iterations lead to the least loss."""
    random = np.random.default_rng(seed)
    closed = np.isfinite(search.low) & np.isfinite(search.high)
    low = np.where(closed, search.low, np.maximum(search.low, x - SPREAD * search.scale))
    high = np.where(closed, search.high, np.minimum(search.high, x + SPREAD * search.scale))
    found = []
    for start in [x, *(random.uniform(low, high) for _ in range(starts - 1))]:
        end, _ = descend(search, objective, start, TRIALS, 0)
        found.append((objective.loss(end), end))
    return min(found, key=lambda pair: pair[0])[1]


def _result(search: Search, objective: Objective, x: np.ndarray, stopped: str) -> FitResult:
    loss, _, curvature = objective.normal_equations(x)
    without = [
        label
        for label, has_slope in zip(
            search.labels, search.has_slope | (curvature.diagonal() != 0), strict=True
        )
        if not has_slope
    ]
    for label in without:
        warnings.warn(
            f"fit: the pictures do not depend on {label}; it stays as it was",
            UserWarning,
            stacklevel=3,
        )
    covariance = _covariance(objective, loss, curvature)
    parameters = objective.parameters(x)
    return FitResult(
        scene=objective.views[0].scene.replace(parameters),
        parameters=parameters,
        uncertainty=objective.parameters(np.sqrt(covariance.diagonal())),
        covariance=covariance,
        labels=search.labels,
        loss=loss,
        gains=objective.gains(x),
        history=search.history,
        stopped=stopped,
        notes=search.notes,
    )


def _covariance(objective: Objective, loss: float, curvature: np.ndarray) -> np.ndarray:
    """Gauss-Newton's estimate: the variance of a residual times the inverse of J'J; infinite where
    J is 0.

    What is left of the residual counts as noise, of the same strength and independent in all
    channels of all pixels.
    """
    total = objective.total
    variance = 2 * loss * total / max(1.0, total - objective.count)
    covariance = np.diag(np.full(len(curvature), np.inf))
    seen = np.flatnonzero(curvature.diagonal() > 0)
    unit = 1 / np.sqrt(curvature.diagonal()[seen])
    inverse = np.linalg.pinv(curvature[np.ix_(seen, seen)] * np.outer(unit, unit), hermitian=True)
    covariance[np.ix_(seen, seen)] = variance / total * inverse * np.outer(unit, unit)
    return covariance
