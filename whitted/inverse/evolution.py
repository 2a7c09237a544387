"""Evolution of a cloud of numbers towards a lower loss, without derivatives.

A generation of numbers is drawn from a normal distribution. The better half of them moves its mean,
and shapes its covariance by the steps that have helped. So it follows a curved valley, and passes
over what is rough on a small scale.

Source: N. Hansen, "The CMA Evolution Strategy: A Tutorial" (2016), arXiv:1604.00772: the algorithm
of appendix A with the rates of table 1, without negative weights.
"""

import math
from collections.abc import Callable

import numpy as np

# A deviation below which steps with derivatives do the rest, in units of the scales
SMALL = 2e-3


def evolve(
    loss: Callable[[np.ndarray], float],
    count: int,
    deviation: float,
    evaluations: int,
    random: np.random.Generator,
    late: Callable[[], bool],
) -> tuple[float, np.ndarray]:
    """The lowest loss of the vectors drawn around 0 until they are close together, and its vector.

    Args:
        loss: of a vector; what is not finite is never the lowest.
        count: length of a vector.
        deviation: of the first generation.
        evaluations: of the loss, at most.
        late: asked after each generation whether to end.
    """
    cloud = _Cloud(count, deviation)
    lowest, best = math.inf, np.zeros(count)
    for _ in range(evaluations // cloud.size):
        steps = cloud.steps(random)
        drawn = cloud.mean + cloud.deviation * steps
        losses = np.nan_to_num([loss(x) for x in drawn], nan=np.inf, posinf=np.inf, neginf=np.inf)
        order = np.argsort(losses, kind="stable")
        if losses[order[0]] < lowest:
            lowest, best = losses[order[0]], drawn[order[0]]
        cloud.select(steps[order[: len(cloud.weights)]])
        if late() or cloud.width < SMALL:
            break
    return lowest, best


class _Cloud:
    """A normal distribution that moves, grows or shrinks, and changes its shape."""

    def __init__(self, count: int, deviation: float) -> None:
        self.size = 4 + int(3 * math.log(count))
        better = self.size // 2
        weights = math.log((self.size + 1) / 2) - np.log(np.arange(1, better + 1))
        self.weights = weights / weights.sum()
        self.mean, self.deviation, self.covariance = np.zeros(count), deviation, np.eye(count)
        self.values, self.axes = np.ones(count), np.eye(count)
        # Sums of the mean's steps, in units of the deviation; in the first all directions are alike
        self.round_path, self.path = np.zeros(count), np.zeros(count)
        self._set_rates(count, 1 / float((self.weights**2).sum()))

    def _set_rates(self, count: int, mass: float) -> None:
        """How fast all of it changes.

        Args:
            mass: how many of the better half count.
        """
        self.mass = mass
        self.round_rate = (mass + 2) / (count + mass + 5)
        excess = max(0.0, math.sqrt((mass - 1) / (count + 1)) - 1)
        self.damping = 1 + 2 * excess + self.round_rate
        self.path_rate = (4 + mass / count) / (count + 4 + 2 * mass / count)
        self.path_share = 2 / ((count + 1.3) ** 2 + mass)
        share = 2 * (mass - 2 + 1 / mass) / ((count + 2) ** 2 + mass)
        self.steps_share = min(1 - self.path_share, share)
        # The expected length of a normal vector
        self.length = math.sqrt(count) * (1 - 1 / (4 * count) + 1 / (21 * count**2))

    @property
    def width(self) -> float:
        """The largest deviation of all directions."""
        return self.deviation * float(self.values.max())

    def steps(self, random: np.random.Generator) -> np.ndarray:
        """A generation, in units of the deviation, from the mean."""
        squares, self.axes = np.linalg.eigh(self.covariance)
        self.values = np.sqrt(np.maximum(squares, 1e-20))
        normal = random.normal(size=(self.size, len(self.mean)))
        return (normal * self.values) @ self.axes.T

    def select(self, steps: np.ndarray) -> None:
        """Follow the better steps, the best first."""
        step = self.weights @ steps
        self.mean = self.mean + self.deviation * step
        # The length of the sum tells whether steps go on in one direction, or back and forth
        alike = self.axes @ ((self.axes.T @ step) / self.values)
        rate = self.round_rate
        self.round_path = (1 - rate) * self.round_path + self._kept(rate) * alike
        grown = float(np.linalg.norm(self.round_path)) / self.length
        self.deviation *= math.exp(rate / self.damping * (grown - 1))
        # The shape, by the sum of steps and by each of them
        rate = self.path_rate
        self.path = (1 - rate) * self.path + self._kept(rate) * step
        kept = 1 - self.path_share - self.steps_share
        self.covariance = (
            kept * self.covariance
            + self.path_share * np.outer(self.path, self.path)
            + self.steps_share * (steps.T * self.weights) @ steps
        )

    def _kept(self, rate: float) -> float:
        """The factor of a step with which a sum of random ones keeps its length."""
        return math.sqrt(rate * (2 - rate) * self.mass)
