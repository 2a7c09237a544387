"""How sure the numbers of a fit are: their covariance, and what the pictures do not tell.

What is left of the residual is noise, and the error of finitely many samples. The latter sits at
edges, where the pictures change most, and is alike in all channels. So the residual is taken as it
is, in squares of 2 x 2 pixels, of which only whole squares are independent of each other.

Source: H. White, "A Heteroskedasticity-Consistent Covariance Matrix Estimator" (1980); of squares:
K.-Y. Liang, S. Zeger, "Longitudinal Data Analysis Using Generalized Linear Models" (1986).
"""

from dataclasses import dataclass

import numpy as np

from .levenberg_marquardt import NULL
from .loss import Objective

# A number has a part in a direction from this part of its scale on
PART, NAMED = 1e-3, 0.1
# A direction is badly known if its deviation is this part of the scales
WEAK = 0.25


@dataclass(frozen=True)
class Uncertainty:
    """What is known of the numbers of a fit."""

    covariance: np.ndarray  # infinite on the diagonal where the pictures do not tell
    weak: tuple[str, ...]  # directions along which they tell little, in words


def uncertainty(objective: Objective, x: np.ndarray, scale: np.ndarray) -> Uncertainty:
    """The uncertainty of the numbers that a fit ends with.

    Args:
        scale: a large change of each number.
    """
    curvature, spread = _sums(objective, x)
    curvature, spread = (matrix * np.outer(scale, scale) for matrix in (curvature, spread))
    seen = curvature.diagonal() > 0
    values, vectors = np.linalg.eigh(curvature)
    known = values > NULL**2 * values[-1]
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T
    covariance = inverse @ spread @ inverse
    badly = np.einsum("ik,ij,jk->k", vectors, covariance, vectors) > WEAK**2
    lost = (np.abs(vectors[:, ~known]) > PART).any(1) | ~seen
    covariance[lost] = covariance[:, lost] = 0
    covariance[lost, lost] = np.inf
    weak = [*_sparse(vectors[:, ~known].T), *vectors[:, known & badly].T]
    # Of numbers without any effect there is nothing to tell but their names
    weak = [vector for vector in weak if (np.abs(vector[~seen]) < NAMED).all()]
    words = tuple(direction(objective.labels(), vector * scale) for vector in weak)
    return Uncertainty(covariance * np.outer(scale, scale), words)


def _sums(objective: Objective, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """J'J, and the sum over squares of pixels of (J'r) (J'r)'."""
    count = objective.count
    curvature, spread = np.zeros((count, count)), np.zeros((count, count))
    for view, residual, jacobian in objective.linearised(x):
        counted = objective.counted(view, residual)
        slopes = np.einsum("hwc,hwck->hwk", counted * residual, jacobian)
        slopes = _squares(slopes).reshape(-1, count)
        spread += slopes.T @ slopes
        weighted = counted[..., None] * jacobian
        curvature += jacobian.reshape(-1, count).T @ weighted.reshape(-1, count)
    # As many numbers as are fitted take their part of the residual with them
    spread = spread * objective.total / max(1.0, objective.total - count)
    if objective.prior is not None:
        known = np.diag(objective.prior.precision * objective.variance)
        curvature, spread = curvature + known, spread + known * objective.variance
    return curvature, spread


def _squares(picture: np.ndarray) -> np.ndarray:
    """Sums over 2 x 2 pixels; the last row and column may stand alone."""
    rows = np.add.reduceat(picture, np.arange(0, picture.shape[0], 2), 0)
    return np.add.reduceat(rows, np.arange(0, picture.shape[1], 2), 1)


def _sparse(vectors: np.ndarray) -> list[np.ndarray]:
    """Vectors that span the same, with many zeros: the reduced row echelon form."""
    rows = vectors.copy()
    for k in range(len(rows)):
        pivot = int(np.abs(rows[k]).argmax())
        rows[k] /= rows[k, pivot]
        others = np.arange(len(rows)) != k
        rows[others] -= np.outer(rows[others, pivot], rows[k])
    return list(rows)


def direction(labels: list[str], vector: np.ndarray) -> str:
    """A direction in words: the numbers that move along it, and how much for one of the first.

    Example:
        >>> direction(["a.x", "a.y", "b"], np.array([2.0, 0.001, -1.0]))
        'a.x +1, b -0.5'
    """
    largest = int(np.abs(vector).argmax())
    vector = vector / vector[largest]
    parts = [k for k in np.argsort(-np.abs(vector), kind="stable") if abs(vector[k]) > NAMED]
    return ", ".join(f"{labels[k]} {vector[k]:+.2g}" for k in parts)
