"""Small functions that keep numbers finite and sums exact.

Source of the error-free sum: T. J. Dekker, "A Floating-Point Technique for Extending the Available
Precision" (1971).
"""

import drjit as dr

from .arrays import Array


def safe_sqrt(x: Array) -> Array:
    """The square root, and zero, with a zero gradient, where x is not above zero."""
    positive = x > 0
    return dr.select(positive, dr.sqrt(dr.select(positive, x, 1)), 0)


def two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """a + b and its rounding error, exactly."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


def smooth_step(low: float, high: float, x: Array) -> Array:
    """0 up to low, 1 from high on, smooth in between."""
    t = dr.fmin(dr.fmax((x - low) / (high - low), 0), 1)
    return t * t * (3 - 2 * t)
