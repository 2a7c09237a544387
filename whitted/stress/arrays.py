"""NumPy's numbers as Dr.Jit's and back, and derivatives of functions of one array."""

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array, Precision
from ..core.host import to_array
from ..core.ray import NONE, Ray


def vectors_of(p: Precision, rows: Any) -> Array:
    """An array of vectors from three rows of numbers, which are broadcast against each other."""
    return p.vector(*(numbers_of(p, row) for row in np.broadcast_arrays(*rows)))


def numbers_of(p: Precision, values: np.ndarray) -> Array:
    """An array of numbers."""
    return to_array(np.ravel(values).astype(p.dtype), np.size(values))


def rays_of(p: Precision, o: Any, d: Any, inward: bool = False) -> Ray:
    """Rays from three rows of origins and of unit directions; they start on no primitive."""
    o, d = vectors_of(p, o), vectors_of(p, d)
    width = max(dr.width(o), dr.width(d))
    uint, mask = dr.uint32_array_t(p.real), dr.mask_t(p.real)
    return Ray(o, d, dr.full(uint, NONE, width), dr.full(mask, inward, width))


def rounded(p: Precision, values: Any) -> np.ndarray:
    """Numbers rounded to a precision, as float64."""
    return np.asarray(values, p.dtype).astype(np.float64)


def worst(values: Any) -> float:
    """The largest absolute value; NaN if one is NaN, 0 of none."""
    values = np.abs(np.asarray(values, np.float64))
    return float(values.max()) if values.size else 0.0


def count(mask: Any) -> float:
    """How many entries are true."""
    return float(np.count_nonzero(np.asarray(mask)))


def slopes(
    function: Callable[[Array], Array], x: Array
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values of an elementwise function, and its derivatives in forward and in reverse mode."""
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
