"""Recover a scene's parameters from pictures of it: least squares over pixels, from coarse pictures to fine ones.

A handful of parameters is fitted by Levenberg and Marquardt's method on Jacobians from forward mode, more by Adam on
gradients from reverse mode. A picture at half the resolution is blurred by a pixel twice as wide, in which an edge is
felt from twice as far, so that a coarse fit finds what a fine one would miss, and a fine one what a coarse one cannot tell.

Sources: D. Marquardt, "An Algorithm for Least-Squares Estimation of Nonlinear Parameters" (1963); D. Kingma, J. Ba, "Adam"
(2015); G. Golub, V. Pereyra, "The Differentiation of Pseudo-Inverses and Nonlinear Least Squares" (1973), for the gain.
"""

import math
import warnings
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import numpy as np
from drjit.opt import Adam

from .convergence import plot, progress_bar
from .objective import Objective, View, split, view
from .ranges import Bounds, limits, scales, start_of
from .scene import Scene

METHODS = ("auto", "lm", "adam")
# Numbers up to which second-order steps cost less than the many first-order ones that they replace
FEW = 16
# A picture is not halved to fewer pixels along its shorter side
COARSEST = 24
# Iterations at each resolution
ITERATIONS = {"lm": 40, "adam": 200}
# A further start is drawn from the bounds, or where they are open from so many times the scale of each number around
# the first, and tried for so many iterations
SPREAD, TRIALS = 4.0, 8
# Adam's first step in units of each number's scale, at the finest resolution, and the last one relative to it
STEP, LAST = 0.05, 0.05
# Adam has converged when the loss of so many iterations is no better than before
PATIENCE = 40


@dataclass(frozen=True)
class Step:
    """An iteration: where it was, and how good."""

    iteration: int
    resolution: tuple[int, int]  # of the first view
    loss: float
    x: np.ndarray


@dataclass
class FitResult:
    """What a fit found."""

    scene: Scene  # the first view's, with the recovered parameters
    parameters: dict[str, Any]  # name to a number or three
    uncertainty: dict[str, Any]  # the same for one standard deviation; infinite where the pictures do not tell
    covariance: np.ndarray  # of all numbers, in the order of `labels`
    labels: list[str]
    loss: float  # half the mean square of the residuals, at the full resolution
    gains: np.ndarray  # (views, 3)
    history: list[Step]
    stopped: str  # why
    notes: list[str] = field(default_factory=list)

    def named(self, x: np.ndarray) -> dict[str, Any]:
        """The parameters at a step's numbers, for `Scene.replace`."""
        return split(self.parameters, x)

    def numbers(self) -> list[tuple[str, float, float]]:
        """A label, the value and one standard deviation of each number."""
        values = np.concatenate([np.ravel(value) for value in self.parameters.values()])
        return list(zip(self.labels, values.tolist(), np.sqrt(self.covariance.diagonal()).tolist(), strict=True))

    def plot(self, path: str | None = None) -> Any:
        """Draw the loss and each parameter over the iterations; needs the extra `fit`.

        Args:
            path: a file to write, by its ending.

        Returns:
            The matplotlib figure.
        """
        return plot(self.history, self.labels, path)


@dataclass
class _Search:
    """What all iterations share."""

    low: np.ndarray
    high: np.ndarray
    scale: np.ndarray
    tolerance: float
    labels: list[str]
    report: Callable[[Step], None]
    history: list[Step] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    felt: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))  # the loss has changed with this number

    def record(self, objective: Objective, loss: float, x: np.ndarray, *slopes: np.ndarray) -> None:
        """Keep an iteration; refuse what is not a number."""
        number = len(self.history)
        for label, value in zip(self.labels, x, strict=True):
            if not math.isfinite(value):
                raise ValueError(f"fit: {label} became {value} in iteration {number}; bound it, or start closer")
        if not math.isfinite(loss):
            raise ValueError(f"fit: the loss became {loss} in iteration {number}, at {_described(self.labels, x)}")
        for slope in slopes:
            self.felt = self.felt | (slope != 0)
            for label in (label for label, value in zip(self.labels, slope, strict=True) if not math.isfinite(value)):
                where = _described(self.labels, x)
                raise ValueError(f"fit: the derivative by {label} is not finite in iteration {number}, at {where}")
        step = Step(number, objective.views[0].resolution, loss, x.copy())
        self.history.append(step)
        self.report(step)

    def bounded(self, x: np.ndarray) -> np.ndarray:
        """The nearest numbers within the bounds."""
        inside = np.clip(x, self.low, self.high)
        for k in np.flatnonzero(inside != x):
            note = f"{self.labels[k]} was held at its bound {inside[k]:g}"
            if note not in self.notes:
                self.notes.append(note)
        return inside


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
    callback: Callable[[Step], None] | None = None,
) -> FitResult:
    """Change a scene's parameters until its picture is the target.

    Args:
        scene: where to start; or several views as pairs (scene, target), or triples with a mask, which share the
            parameters. Their number of pixels decides what each counts for.
        target: linear RGB of shape (height, width, 3).
        wrt: names of parameters, as in `Scene.parameters`.
        method: "lm" (Levenberg-Marquardt), "adam", or "auto", which takes "lm" for up to 16 numbers.
        spp: samples a pixel, a perfect square.
        iterations: at each resolution, at most [default: 40 for "lm", 200 for "adam"].
        levels: resolutions, each half the next [default: as many as leave 24 pixels along the shorter side].
        starts: places to start from: the scene's, and others drawn at random within the bounds, or around it where those
            are open. All are tried at the coarsest resolution, and the best goes on.
        seed: of that draw.
        bounds: name to (lowest, highest), None where open [default: what is legal, and an index of at least 1].
        mask: what each pixel counts for, >= 0, of shape (height, width).
        gain: each channel of a view may be brighter by a factor, which is fitted along: for targets of unknown exposure.
        boundary, max_depth: of `render`; boundary=False differentiates samples alone, and fails at edges.
        resolution: width and height of the target, in place of the scene's.
        tolerance: ends an "lm" fit when a step is below this part of each number's scale.
        progress: show a bar on a terminal's standard error.
        callback: called after each iteration.

    Returns:
        The result; Ctrl-C ends the fit and gives the best so far.

    Raises:
        KeyError: a name that a scene does not have, or bounds for a name that is not fitted.
        ValueError: another argument that is out of range, a target that does not fit the scene, or a number that ceases
            to be finite; the message has the parameter and the iteration.
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
    low, high = limits(first, names, bounds or {})

    with progress_bar(objective.labels()) if progress else nullcontext(lambda step: None) as show:

        def report(step: Step) -> None:
            show(step)
            if callback is not None:
                callback(step)

        search = _Search(low, high, scales(first, names), tolerance, objective.labels(), report, felt=np.zeros(len(x), bool))
        stopped = "interrupted"
        try:
            x, stopped = _coarse_to_fine(search, objective, x, chosen, iterations, levels, starts, seed)
        except KeyboardInterrupt:
            x = _best(search, x)
        return _result(search, objective, x, stopped)


def _names(wrt: Sequence[str]) -> list[str]:
    names = [wrt] if isinstance(wrt, str) else list(wrt)
    if not names:
        raise ValueError("wrt: expected names of parameters, got an empty list; Scene.parameters() has them all")
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


def _views(scene: Scene | Sequence[tuple], target: object, mask: object, resolution: tuple[int, int] | None) -> list[View]:
    if isinstance(scene, Scene):
        if target is None:
            raise ValueError("target: expected an image, got None")
        return [view(scene, target, mask, resolution, "")]
    if target is not None or mask is not None:
        raise ValueError("target: with several views, give each as (scene, target) or (scene, target, mask)")
    views = list(scene)
    if not views or not all(isinstance(one, tuple) and len(one) in (2, 3) and isinstance(one[0], Scene) for one in views):
        raise ValueError("scene: expected a scene, or pairs (scene, target)")
    return [view(one[0], one[1], one[2] if len(one) == 3 else None, resolution, f"view {k}: ") for k, one in enumerate(views)]


def _coarse_to_fine(
    search: _Search,
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
    count = levels or max(1, 1 + int(math.log2(smallest / COARSEST))) if smallest >= 2 * COARSEST else levels or 1
    if smallest < 1 << (count - 1):
        raise ValueError(f"levels: {count} halvings leave nothing of {smallest} pixels")
    pyramid = [objective]
    for _ in range(count - 1):
        pyramid.insert(0, pyramid[0].halved())
    descend = {"lm": _levenberg_marquardt, "adam": _adam}[method]
    steps = iterations or ITERATIONS[method]
    if starts > 1:
        x = _best_start(search, pyramid[0], x, descend, starts, seed)
    for level, one in enumerate(pyramid):
        x, stopped = descend(search, one, x, steps, len(pyramid) - 1 - level)
    return x, stopped


def _best_start(search: _Search, objective: Objective, x: np.ndarray, descend: Callable, starts: int, seed: int) -> np.ndarray:
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


def _levenberg_marquardt(
    search: _Search, objective: Objective, x: np.ndarray, iterations: int, level: int
) -> tuple[np.ndarray, str]:
    """Steps (A + damping diag A)^-1 g, A = J'J and g = J'r, of which those are taken that lower the loss."""
    damping = 1e-3
    # What a coarse fit leaves, the next one does
    tolerance = search.tolerance * 10.0 ** (2 * min(level, 1))
    loss, slope, curvature = objective.normal_equations(x)
    search.record(objective, loss, x, slope, curvature.diagonal())
    for _ in range(iterations):
        if not curvature.any():
            return x, "the pictures do not change with any of the parameters here; start elsewhere, or from several starts"
        taken = False
        while not taken and damping < 1e6:
            step = _step(search, x, slope, curvature, damping)
            after = search.bounded(x + step) - x
            if np.abs(after / search.scale).max() < tolerance:
                return x, "converged: steps are below the tolerance"
            taken = objective.loss(x + after) < loss
            damping = max(damping / 5, 1e-7) if taken else damping * 4
        if not taken:
            return x, "converged: no step lowers the loss"
        x = x + after
        loss, slope, curvature = objective.normal_equations(x)
        search.record(objective, loss, x, slope, curvature.diagonal())
    return x, "iterations used up"


def _step(search: _Search, x: np.ndarray, slope: np.ndarray, curvature: np.ndarray, damping: float) -> np.ndarray:
    """A damped step of the numbers that can move, none by more than its scale."""
    diagonal = curvature.diagonal()
    stuck = ((x <= search.low) & (slope > 0)) | ((x >= search.high) & (slope < 0)) | (diagonal <= 0)
    free = np.flatnonzero(~stuck)
    step = np.zeros(len(x))
    # In units in which all diagonal elements are 1
    unit = 1 / np.sqrt(diagonal[free])
    matrix = curvature[np.ix_(free, free)] * np.outer(unit, unit) + (damping + 1e-9) * np.eye(len(free))
    step[free] = -unit * np.linalg.solve(matrix, unit * slope[free])
    return step / max(1.0, float(np.abs(step / search.scale).max()))


def _adam(search: _Search, objective: Objective, x: np.ndarray, iterations: int, level: int) -> tuple[np.ndarray, str]:
    """Adam's steps, in units of each number's scale, which shrink to the end."""
    scene, sizes = objective.views[0].scene, objective.sizes
    start = objective.parameters(x)
    types = {name: type(value) for name, value in scene.parameters(*objective.names).items()}
    optimiser = Adam(1.0, params={name: types[name](*np.ravel(value).tolist()) for name, value in start.items()})
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    best, before = (math.inf, x), 0
    for k in range(iterations):
        shrink = LAST ** (k / max(1, iterations - 1)) * 2.0**level * STEP
        optimiser.set_learning_rate({name: shrink * float(search.scale[i]) for name, i in zip(start, first, strict=True)})
        values = dict(optimiser.items())
        loss = objective.gradient(values)
        slope = np.concatenate([dr.grad(value).numpy().ravel() for value in values.values()]).astype(np.float64)
        search.record(objective, loss, x, slope)
        if not slope.any() and best[0] == math.inf:
            return x, "the pictures do not change with any of the parameters here; start elsewhere, or from several starts"
        if loss < best[0] * (1 - 1e-4):
            before = k
        if loss < best[0]:
            best = loss, x
        if k - before > PATIENCE:
            return best[1], "converged: the loss falls no further"
        optimiser.step()
        x = np.concatenate([value.numpy().ravel() for value in optimiser.values()]).astype(np.float64)
        inside = search.bounded(x)
        if (inside != x).any():
            x = inside
            for name, value in objective.parameters(x).items():
                optimiser[name] = types[name](*np.ravel(value).tolist())
    return best[1], "iterations used up"


def _best(search: _Search, x: np.ndarray) -> np.ndarray:
    """The best numbers so far, at the resolution that was reached."""
    last = [step for step in search.history if step.resolution == search.history[-1].resolution]
    return min(last, key=lambda step: step.loss).x if last else x


def _result(search: _Search, objective: Objective, x: np.ndarray, stopped: str) -> FitResult:
    loss, _, curvature = objective.normal_equations(x)
    unfelt = [label for label, felt in zip(search.labels, search.felt | (curvature.diagonal() != 0), strict=True) if not felt]
    for label in unfelt:
        warnings.warn(f"fit: the pictures do not depend on {label}; it stays as it was", UserWarning, stacklevel=3)
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
    """Gauss-Newton's estimate: the variance of a residual times the inverse of J'J; infinite where J is 0.

    What is left of the residual counts as noise, of the same strength and independent in all channels of all pixels.
    """
    total = objective.total
    variance = 2 * loss * total / max(1.0, total - objective.count)
    covariance = np.diag(np.full(len(curvature), np.inf))
    seen = np.flatnonzero(curvature.diagonal() > 0)
    unit = 1 / np.sqrt(curvature.diagonal()[seen])
    inverse = np.linalg.pinv(curvature[np.ix_(seen, seen)] * np.outer(unit, unit), hermitian=True)
    covariance[np.ix_(seen, seen)] = variance / total * inverse * np.outer(unit, unit)
    return covariance


def _described(labels: list[str], x: np.ndarray) -> str:
    return ", ".join(f"{label} = {value:.6g}" for label, value in zip(labels, x, strict=True))
