"""Second-order steps, for a handful of numbers.

Source: D. Marquardt, "An Algorithm for Least-Squares Estimation of Nonlinear Parameters" (1963).
"""

import math

import numpy as np

from .loss import Objective
from .search import LATE, NO_SLOPE, Search

# The first damping. It falls by FALL after a good step and grows by GROWTH after a bad one, and
# stays between LEAST and MOST. After a bad step it is at least AGAIN: less hardly changes the step
DAMPING, FALL, GROWTH, LEAST, MOST, AGAIN = 1e-3, 5, 10, 1e-7, 1e6, 0.1
# The least damping of all: it keeps the matrix regular where two numbers do the same
REGULAR = 1e-9
# Of a direction along which pictures do not change: its part of the largest change
NULL = 1e-6
# A coarse fit ends at this many times the tolerance, and this many times the least step in standard
# errors: the next fit does the rest
COARSE, COARSE_ERRORS = 100, 30
# An undamped step of up to so many times the least length is the last one, if it is to lower the
# loss by no more than a part of it. If it does, the next would be far shorter; if not, the loss is
# too uneven for steps of that length
SHORT, SLIGHT = 50, 0.02
BY_ERRORS = "converged: steps are as short as the standard errors"


def levenberg_marquardt(
    search: Search, objective: Objective, x: np.ndarray, iterations: int, level: int
) -> tuple[np.ndarray, str]:
    """Take those steps -(A + damping diag A)^-1 g that lower the loss, where A = J'J and g = J'r.

    Args:
        level: how often the pictures' resolution is halved; 0 for the last fit.

    Returns:
        The numbers, and why the search ended.
    """
    damping = DAMPING
    tolerance = search.tolerance * (COARSE if level else 1)
    least = search.least_errors * (COARSE_ERRORS if level else 1)
    loss, slope, curvature = objective.normal_equations(x)
    search.record(objective, loss, x, slope, curvature.diagonal())
    for _ in range(iterations):
        if not curvature.any():
            return x, NO_SLOPE
        variance = 2 * loss / objective.total
        whole = _step(search, x, slope, curvature, 0.0)
        errors = _in_errors(whole, curvature, variance)
        last = errors < SHORT * search.least_errors and errors**2 < SLIGHT * objective.total
        last = last and _is_free(search, x, whole)
        taken = False
        while not taken and damping < MOST:
            if search.late:
                return x, LATE
            step = whole if last else _step(search, x, slope, curvature, damping)
            after = search.bounded(x + step / max(1.0, float(np.abs(step / search.scale).max())))
            step = after - x
            if np.abs(step / search.scale).max() < tolerance:
                return x, "converged: steps are below the tolerance"
            if _in_errors(step, curvature, variance) < least:
                return x, BY_ERRORS
            lowered = objective.loss(after)
            taken = lowered < loss
            if last and not taken:
                return x, BY_ERRORS
            damping = max(damping / FALL, LEAST) if taken else max(damping * GROWTH, AGAIN)
        if not taken:
            return x, "converged: no step lowers the loss"
        x = after
        search.steps += 1
        if last:
            search.record(objective, lowered, x)
            return x, BY_ERRORS
        loss, slope, curvature = objective.normal_equations(x)
        search.record(objective, loss, x, slope, curvature.diagonal())
    return x, "iterations used up"


def _in_errors(step: np.ndarray, curvature: np.ndarray, variance: float) -> float:
    """The length of a step in standard errors: the numbers' covariance is variance * A^-1.

    Args:
        variance: of a residual.
    """
    return math.sqrt(step @ curvature @ step / variance) if variance else math.inf


def _is_free(search: Search, x: np.ndarray, step: np.ndarray) -> bool:
    """Whether no bound and no scale holds a step back."""
    after = x + step
    near = (after >= search.low) & (after <= search.high) & (np.abs(step) <= search.scale)
    return bool(near.all())


def _step(
    search: Search, x: np.ndarray, slope: np.ndarray, curvature: np.ndarray, damping: float
) -> np.ndarray:
    """A damped step of the numbers that can move."""
    diagonal = curvature.diagonal()
    # A step may have ended a rounding beside a bound
    near = search.tolerance * search.scale
    at_bound = ((x <= search.low + near) & (slope > 0)) | ((x >= search.high - near) & (slope < 0))
    free = np.flatnonzero(~at_bound & (diagonal > 0))
    step = np.zeros(len(x))
    # In units in which all diagonal elements are 1
    unit = 1 / np.sqrt(diagonal[free])
    matrix = curvature[np.ix_(free, free)] * np.outer(unit, unit)
    matrix += (damping + REGULAR) * np.eye(len(free))
    step[free] = -unit * np.linalg.solve(matrix, unit * slope[free])
    step[free] = _told(step[free], curvature[np.ix_(free, free)], search.scale[free])
    return step


def _told(step: np.ndarray, curvature: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """A step without its part along directions in which the pictures do not change.

    Roundings would take it far along them.
    """
    values, vectors = np.linalg.eigh(curvature * np.outer(scale, scale))
    told = vectors[:, values > NULL**2 * values.max(initial=0)]
    return scale * (told @ (told.T @ (step / scale)))
