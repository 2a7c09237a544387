"""A hard case: a known answer, and bounds on the error of each precision."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Precision


@dataclass(frozen=True)
class Check:
    """One comparison of a case."""

    what: str
    error: float
    bound: float

    @property
    def passed(self) -> bool:
        """The error is at most its bound; NaN never is."""
        return bool(self.error <= self.bound)

    @property
    def ratio(self) -> float:
        """The error over its bound; infinite for NaN, and for any error above a bound of 0."""
        if math.isnan(self.error) or self.bound == 0:
            return 0.0 if self.passed else math.inf
        return self.error / self.bound


@dataclass(frozen=True)
class Curve:
    """The error of a method against what makes the case hard."""

    label: str
    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class Chart:
    """The errors of several methods."""

    title: str
    x: str
    y: str
    curves: tuple[Curve, ...]
    tolerance: float  # a method with a larger error counts as broken
    linear: bool = False  # a linear axis of x, in place of a logarithmic one


@dataclass(frozen=True)
class Case:
    """A hard case."""

    number: int
    name: str
    answer: str  # what is right
    why: str  # where the bounds come from
    checks: Callable[[Precision], Iterable[Check]]
    chart: Callable[[], Chart] | None = None
    limit: str = ""  # what single precision cannot do
