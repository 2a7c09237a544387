"""Dr.Jit arrays of either precision, and the choice among several values by an index."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import ad

# A Dr.Jit array. Its concrete type depends on the precision, and is derived from the arguments.
Array = Any
# Values of parameters, or their derivatives, by name
Parameters = dict[str, Array]


@dataclass(frozen=True)
class Precision:
    """The types of a precision."""

    name: str
    real: Any
    vector2: Any
    vector: Any
    vector4: Any
    tensor: Any
    columns: Any  # several numbers a lane
    dtype: Any  # NumPy's type of a number
    epsilon: float  # spacing of the numbers just above 1


SINGLE = Precision(
    "single",
    ad.Float,
    ad.Array2f,
    ad.Array3f,
    ad.Array4f,
    ad.TensorXf,
    ad.ArrayXf,
    np.float32,
    2.0**-23,
)
DOUBLE = Precision(
    "double",
    ad.Float64,
    ad.Array2f64,
    ad.Array3f64,
    ad.Array4f64,
    ad.TensorXf64,
    ad.ArrayXf64,
    np.float64,
    2.0**-52,
)
PRECISIONS = (SINGLE, DOUBLE)


def precision_named(name: str) -> Precision:
    """The precision of this name.

    Raises:
        ValueError: there is none.
    """
    for precision in PRECISIONS:
        if precision.name == name:
            return precision
    raise ValueError(f"precision: expected 'single' or 'double', got {name!r}")


def precision_of(array: Array) -> Precision:
    """The precision of an array or a vector of real numbers."""
    return SINGLE if dr.type_v(array) is dr.VarType.Float32 else DOUBLE


def select(index: Array, table: Iterable[tuple[int, Array]], default: Array) -> Array:
    """The value whose number is the index, and the default where no number is."""
    chosen = default
    for number, value in table:
        chosen = dr.select(index == number, value, chosen)
    return chosen


def any_true(masks: Iterable[Array], like: Array) -> Array:
    """Bool: one of some masks holds. `like` is any mask, whose type is taken."""
    result = type(like)(False)
    for mask in masks:
        result |= mask
    return result
