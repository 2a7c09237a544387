"""Robust losses: what the scene lacks in a few places does not pull at its numbers.

A pixel's residual u is in units of the target's noise. Beyond some units it counts less than its
square. Then things that the scene does not have, such as a finger before the lens, are left alone.

Source: P. Huber, "Robust Estimation of a Location Parameter" (1964); P. Holland, R. Welsch, "Robust
Regression Using Iteratively Reweighted Least-Squares" (1977).
"""

import numpy as np

# The residual at which a pixel begins to count less. With noise alone, that widens bars by 2.5 %
TURN = {"huber": 1.345, "cauchy": 2.385}
# A pixel with less of its weight than this is left out
HALF = 0.5


def check_robust(kind: object, gain: bool) -> None:
    """Check the name of a robust loss.

    Raises:
        ValueError: the loss is not known, or gains are fitted along.
    """
    if kind is not None and kind not in TURN:
        raise ValueError(f"robust: expected one of {', '.join(TURN)}, or None, got {kind!r}")
    if kind is not None and gain:
        raise ValueError("robust: not with gain=True; fit an intensity in place of a gain")


def robust_loss(kind: str, square: np.ndarray) -> np.ndarray:
    """What counts in place of the square of u.

    Args:
        square: of u, any shape.
    """
    turn = TURN[kind]
    if kind == "cauchy":
        return turn**2 * np.log1p(square / turn**2)
    return np.where(square <= turn**2, square, 2 * turn * np.sqrt(square) - turn**2)


def robust_weight(kind: str, square: np.ndarray) -> np.ndarray:
    """The derivative of `robust_loss` by the square of u: 1 for small u, less for large."""
    turn = TURN[kind]
    if kind == "cauchy":
        return 1 / (1 + square / turn**2)
    return turn / np.maximum(turn, np.sqrt(square))


def left_out(weight: np.ndarray) -> np.ndarray:
    """Pixels that a robust loss leaves out, with their neighbours.

    Args:
        weight: of each pixel, from 0 to 1, shape (height, width, 1).

    Returns:
        Truth values of the same shape.
    """
    wide = np.pad(weight[..., 0] < HALF, 1)
    height, width = weight.shape[:2]
    shifts = [wide[j : j + height, i : i + width] for j in range(3) for i in range(3)]
    return np.any(shifts, axis=0)[..., None]
