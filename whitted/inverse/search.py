"""What all iterations of a fit share: bounds, scales, and what happened so far."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .convergence import Iteration
from .loss import Objective

LATE = "budget used up"
NO_SLOPE = (
    "the pictures do not change with any of the parameters here; "
    "start elsewhere, or from several starts"
)


@dataclass
class Search:
    """A search for the numbers that make pictures of a scene those that are asked for."""

    low: np.ndarray
    high: np.ndarray
    scale: np.ndarray  # a large change of each number
    tolerance: float  # ends Levenberg-Marquardt, in units of the scales
    least_errors: float  # ends it as well: the length of a step, in standard errors
    labels: list[str]
    report: Callable[[Iteration], None]
    history: list[Iteration] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    steps: int = 0  # taken so far
    attempt: int = 0  # the number of further tries
    deadline: float = math.inf  # of all descents, or of tries, on the clock of `time.monotonic`

    def __post_init__(self) -> None:
        # Bool for each number: some slope by it was not 0
        self.has_slope = np.zeros(len(self.labels), bool)

    @property
    def late(self) -> bool:
        return time.monotonic() > self.deadline

    def record(self, objective: Objective, loss: float, x: np.ndarray, *slopes: np.ndarray) -> None:
        """Keep the numbers that a step has led to, or those where the steps of a fit start.

        Raises:
            ValueError: something is not a finite number; the message has the parameter and the
                iteration.
        """
        iteration = f"iteration {self.steps}"
        for label, value in zip(self.labels, x, strict=True):
            if not math.isfinite(value):
                raise ValueError(
                    f"fit: {label} became {value} in {iteration}; bound it, or start closer"
                )
        numbers = zip(self.labels, x, strict=True)
        at = ", ".join(f"{label} = {value:.6g}" for label, value in numbers)
        if not math.isfinite(loss):
            raise ValueError(f"fit: the loss became {loss} in {iteration}, at {at}")
        for slope in slopes:
            self.has_slope = self.has_slope | (slope != 0)
            for label, value in zip(self.labels, slope, strict=True):
                if not math.isfinite(value):
                    raise ValueError(
                        f"fit: the derivative by {label} is not finite in {iteration}, at {at}"
                    )
        step = Iteration(self.steps, objective.views[0].resolution, loss, x.copy(), self.attempt)
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

    def best(self, x: np.ndarray) -> np.ndarray:
        """The best numbers so far, at the resolution that was reached.

        Args:
            x: what to return before the first iteration.
        """
        last = [step for step in self.history if step.resolution == self.history[-1].resolution]
        return min(last, key=lambda step: step.loss).x if last else x
