"""A hard case: a question with a known answer, and how far each precision may be from it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array, Precision
from ..core.ray import NONE, Ray


@dataclass(frozen=True)
class Check:
    """One comparison of a case."""

    what: str
    error: float
    bound: float

    @property
    def passed(self) -> bool:
        return bool(self.error <= self.bound)

    @property
    def share(self) -> float:
        """The error over its bound, infinite for one that is not a number."""
        if not self.error <= self.bound:
            return np.inf if np.isnan(self.error) or self.bound == 0 else self.error / self.bound
        return self.error / self.bound if self.bound else 0.0


@dataclass(frozen=True)
class Curve:
    """A method's error against what makes the case hard."""

    label: str
    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True)
class Chart:
    """Errors of several methods, and the error from which a method counts as broken."""

    title: str
    x: str
    y: str
    curves: tuple[Curve, ...]
    broken: float
    linear: bool = False  # x counts something, and is not drawn in powers of ten


@dataclass(frozen=True)
class Case:
    """A hard case, with a function that yields its checks in a precision, and one that makes its
    chart.
    """

    number: int
    name: str
    answer: str
    why: str  # where its bounds come from
    checks: Callable[[Precision], Iterable[Check]]
    chart: Callable[[], Chart] | None = None
    limit: str = ""  # what single precision cannot do


def vectors_of(p: Precision, rows: Any) -> Array:
    """An array of vectors from three rows of numbers."""
    return p.vector(
        *(p.real(np.ascontiguousarray(row, p.dtype)) for row in np.broadcast_arrays(*rows))
    )


def rounded(p: Precision, values: Any) -> np.ndarray:
    """Numbers as a precision has them, in double."""
    return np.asarray(values, p.dtype).astype(np.float64)


def rays_of(p: Precision, o: Any, d: Any, inward: bool = False) -> Ray:
    """Rays from rows of numbers, which start on no primitive."""
    o, d = vectors_of(p, o), vectors_of(p, d)
    width = max(dr.width(o), dr.width(d))
    uint, mask = dr.uint32_array_t(p.real), dr.mask_t(p.real)
    return Ray(o, d, dr.full(uint, NONE, width), dr.full(mask, inward, width))


def worst(values: Any) -> float:
    """The largest modulus, and NaN where one is not a number; 0 of none."""
    values = np.abs(np.asarray(values, np.float64))
    return float(values.max()) if values.size else 0.0


def count(mask: Any) -> float:
    """How many are true."""
    return float(np.count_nonzero(np.asarray(mask)))


def slopes(
    function: Callable[[Array], Array], x: Array
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The values of an elementwise function at x, and its derivatives, forward and reverse."""
    inputs = type(x)(x), type(x)(x)
    dr.enable_grad(inputs)
    forward = function(inputs[0])
    dr.set_grad(inputs[0], 1)
    dr.enqueue(dr.ADMode.Forward, inputs[0])
    dr.traverse(dr.ADMode.Forward)
    dr.backward(dr.sum(function(inputs[1])))
    arrays = dr.detach(forward), dr.grad(forward), dr.grad(inputs[1])
    value, by_forward, by_reverse = (array.numpy().astype(np.float64) for array in arrays)
    return value, by_forward, by_reverse
