"""Levenberg and Marquardt's method on small problems, against SciPy's."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.optimize import least_squares, lsq_linear

from whitted.inverse.levenberg_marquardt import levenberg_marquardt
from whitted.inverse.search import Search

TIMES = np.linspace(0, 4, 15)
# A decay, and what no decay explains
DECAY = 2.5 * np.exp(-0.8 * TIMES) + 0.1 * np.sin(9 * TIMES)
TURN = np.linspace(0, 5, 12)
ROUND = np.array([3 + 2 * np.cos(TURN), -1 + 2 * np.sin(TURN)]) + 0.1 * np.cos(7 * TURN)


@dataclass(frozen=True)
class Problem:
    """Residuals of a vector of numbers and their Jacobian, with what a fit asks of an objective."""

    residuals: object
    jacobian: object
    start: tuple
    low: tuple = ()
    high: tuple = ()

    views = (SimpleNamespace(resolution=(1, 1)),)

    @property
    def total(self):
        """Residuals; the loss is half the sum of their squares."""
        return len(self.residuals(np.array(self.start)))

    @property
    def bounds(self):
        free = np.full(len(self.start), np.inf)
        low, high = (bound if len(bound) else free for bound in (self.low, self.high))
        return (low if len(self.low) else -free), high

    def loss(self, x):
        return self.normal_equations(x)[0]

    def normal_equations(self, x):
        r, j = self.residuals(x), self.jacobian(x)
        return r @ r / 2, j.T @ r, j.T @ j


def line(x):
    return x[0] + x[1] * TIMES - DECAY


def of_line(x):
    return np.stack([np.ones_like(TIMES), TIMES], -1)


def decay(x):
    return x[0] * np.exp(-x[1] * TIMES) - DECAY


def of_decay(x):
    fall = np.exp(-x[1] * TIMES)
    return np.stack([fall, -x[0] * TIMES * fall], -1)


def valley(x):
    """Rosenbrock's function: its minimum is at the end of a valley in the shape of a parabola."""
    return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])


def of_valley(x):
    return np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def circle(x):
    """Distances of points from a circle of center (x0, x1) and radius x2."""
    return np.hypot(*(ROUND - x[:2, None])) - x[2]


def of_circle(x):
    away = ROUND - x[:2, None]
    return np.stack([*(-away / np.hypot(*away)), -np.ones(away.shape[1])], -1)


PROBLEMS = {
    "line": Problem(line, of_line, (0, 0)),
    "decay": Problem(decay, of_decay, (1, 0.1)),
    "valley": Problem(valley, of_valley, (-1.2, 1)),
    "circle": Problem(circle, of_circle, (0, 0, 1)),
    "line with a bound": Problem(line, of_line, (0, 0), (-9, -0.2), (9, 9)),
    "decay with a bound": Problem(decay, of_decay, (1, 0.1), (0, 0), (9, 0.5)),
    "valley with a bound": Problem(valley, of_valley, (-1.2, 1), (-2, -2), (0.5, 2)),
    "circle in a corner": Problem(circle, of_circle, (0, 0, 1), (-2, -0.5, 0.5), (2.5, 2, 9)),
    "start at a bound": Problem(decay, of_decay, (1, 0), (0, 0), (1, 2)),
}


def search_for(problem, least_errors=0.0):
    n = len(problem.start)
    labels = [f"x{k}" for k in range(n)]
    ends = 1e-10, least_errors
    return Search(*map(np.array, problem.bounds), np.ones(n), *ends, labels, lambda step: None)


def minimum(problem, iterations=500):
    """Where the method ends, and why."""
    search = search_for(problem)
    return levenberg_marquardt(search, problem, np.array(problem.start, float), iterations, 0)


def test_a_try_ends_with_the_budget():
    problem = PROBLEMS["valley"]
    search = search_for(problem)
    search.deadline = -np.inf
    x, stopped = levenberg_marquardt(search, problem, np.array(problem.start, float), 500, 0)
    assert stopped == "budget used up"
    assert tuple(x) == problem.start


@pytest.mark.parametrize("name", ["line", "decay"])
def test_steps_below_the_standard_errors_end_the_search(name):
    problem, least = PROBLEMS[name], 0.1
    start = np.array(problem.start, float)
    found, stopped = levenberg_marquardt(search_for(problem, least), problem, start, 500, 0)
    assert stopped == "converged: steps are as short as the standard errors"
    loss, _, curvature = problem.normal_equations(expected(problem))
    off = found - expected(problem)
    # The last step is shorter than fifty times `least`, and, among so few residuals, than one that
    # changes the loss by 2 %. The rest is shorter than the last step
    most = min((50 * least) ** 2, 0.02 * problem.total)
    assert off @ curvature @ off < most * 2 * loss / problem.total


@dataclass(frozen=True)
class Noisy(Problem):
    """A problem whose loss grows by any step from the start, as where noise drowns the slope."""

    tries: list = field(default_factory=list)

    def loss(self, x):
        self.tries.append(x)
        return super().loss(np.array(self.start)) + 1e-3


def test_a_search_ends_after_few_tries_where_no_step_lowers_the_loss():
    problem = Noisy(decay, of_decay, (1, 0.1))
    found, stopped = minimum(problem)
    assert stopped == "converged: no step lowers the loss"
    assert tuple(found) == problem.start
    # Each step is about a tenth of the one before, once the damping is above 1: from 0.1 to 1e6
    assert len(problem.tries) <= 9


def expected(problem):
    return least_squares(
        problem.residuals,
        problem.start,
        problem.jacobian,
        problem.bounds,
        method="dogbox",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    ).x


@pytest.mark.parametrize("name", PROBLEMS)
def test_minimum_is_that_of_scipy(name):
    problem = PROBLEMS[name]
    found, stopped = minimum(problem)
    low, high = problem.bounds
    assert (found >= low).all()
    assert (found <= high).all()
    assert stopped.startswith("converged")
    # Within 1e-8 of its minimum the loss is flat but for roundings, and no step lowers it
    np.testing.assert_allclose(found, expected(problem), rtol=0, atol=1e-6)


tenths = st.integers(-20, 20).map(lambda k: k / 10)
three = st.tuples(tenths, tenths, tenths)


# A number ends within a rounding of a bound. Were it free to move, its step would be cut off, and
# those of the others, which were chosen with it, would lead nowhere
BESIDE_A_BOUND = {
    "rows": ((0, 0, 0), (-0.6, -0.1, 1.3), (-0.6, 1.1, 0)),
    "values": (0, 0, -1.4),
    "low": (-0.3, 0.8, -0.1),
    "widths": (12, 1, 3),
}


@given(st.tuples(three, three, three), three, three, st.tuples(*[st.integers(1, 30)] * 3))
@example(**BESIDE_A_BOUND)
def test_minimum_of_a_linear_problem_within_any_bounds_is_that_of_scipy(rows, values, low, widths):
    """Three rows of numbers, and a unit matrix below, which keeps the problem well conditioned."""
    matrix, values = np.concatenate([rows, np.eye(3)]), np.array([*values, 0, 0, 0])
    low, high = np.array(low), np.array(low) + np.array(widths) / 10
    problem = Problem(
        lambda x: matrix @ x - values, lambda x: matrix, tuple((low + high) / 2), low, high
    )
    right = lsq_linear(matrix, values, (low, high), method="bvls", tol=1e-15).x
    np.testing.assert_allclose(minimum(problem)[0], right, rtol=0, atol=1e-6)
