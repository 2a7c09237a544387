"""Powers of cosines, fast enough for a highlight at every node of a tree of rays.

Dr.Jit's logarithm and exponential also serve arguments that a cosine never is: those take a third
of their time.
"""

from collections.abc import Sequence
from typing import Any

import drjit as dr

from .arrays import SINGLE, Array, precision_of

# log2(1 + f) / f, for 1 + f from sqrt(1/2) to sqrt(2), to 3e-8 of its value
LOGARITHM = (
    1.4426950216,
    -0.7213473320,
    0.4809106290,
    -0.3607036769,
    0.2879162431,
    -0.2389448285,
    0.2157156169,
    -0.2072696835,
    0.1258368939,
)
# 2^r, for r from -1/2 to 1/2, to 2e-9 of its value
EXPONENTIAL = (
    1.0,
    0.6931471825,
    0.2402264625,
    0.0555032864,
    0.0096184891,
    0.0013399931,
    0.0001534581,
)
# The square root of 1/2, as the bits of a single-precision number
ROOT_HALF = 0x3F3504F3
# A number this large has no digits after the point, and its last bits are a whole number
WHOLE = 1.5 * 2.0**23
# Cosines this close to 0 count as positive, but no smaller
LEAST = 1e-30


def power(cosine: Array, exponent: Array) -> Array:
    """max(0, cosine)^exponent of an exponent above 0, and 0 where the cosine is 0."""
    positive = cosine > 0
    if precision_of(cosine) is SINGLE and not dr.grad_enabled(cosine, exponent):
        result = _exp2(exponent * _log2(dr.fmin(dr.fmax(cosine, LEAST), 1)))
    else:
        # Dr.Jit's exp2 is infinite at the lower end of double precision's range
        result = dr.exp2(dr.fmax(exponent * dr.log2(dr.select(positive, cosine, 1)), -1000))
    return dr.select(positive, result, 0)


def _log2(x: Array) -> Array:
    """The logarithm of a single-precision number above 0 that is not too small (denormal)."""
    integer: Any = dr.int32_array_t(x)
    bits: Any = dr.reinterpret_array(integer, x)
    whole = (bits - ROOT_HALF) >> 23
    rest: Any = dr.reinterpret_array(type(x), bits - (whole << 23))
    rest -= 1
    return dr.fma(rest, polynomial(rest, LOGARITHM), type(x)(whole))


def _exp2(y: Array) -> Array:
    """2^y of a single-precision number that is not above 0; 0 where that is too small for one."""
    integer: Any = dr.int32_array_t(y)
    y = dr.fmax(y, -127)
    shifted = y + WHOLE
    power = polynomial(y - (shifted - WHOLE), EXPONENTIAL)
    bits: Any = dr.reinterpret_array(integer, power)
    doublings: Any = dr.reinterpret_array(integer, shifted)
    return dr.reinterpret_array(type(y), bits + (doublings << 23))


def polynomial(x: Array, coefficients: Sequence[Array]) -> Array:
    """A polynomial, from its constant term on, whose terms a CPU can compute side by side.

    Source: G. Estrin, "Organization of Computer Systems: The Fixed Plus Variable Structure
    Computer" (1960).
    """
    terms = list(coefficients)
    while len(terms) > 1:
        pairs = zip(terms[::2], terms[1::2], strict=False)
        last = terms[-1:] if len(terms) % 2 else []
        terms = [dr.fma(x, high, low) for low, high in pairs] + last
        x = x * x
    return terms[0]
