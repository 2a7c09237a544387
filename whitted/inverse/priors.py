"""Priors: what is known of numbers before there is a picture."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..scene.scene import Scene
from .bounds import start_of

Priors = Mapping[str, tuple[Any, Any]]


@dataclass(frozen=True)
class Prior:
    """Normal distributions of all numbers of a fit, infinitely wide where nothing is known."""

    mean: np.ndarray
    precision: np.ndarray  # 1 / sigma^2

    def loss(self, x: np.ndarray) -> float:
        """Half the sum of squared deviations from the means, in units of sigma."""
        return float(self.precision @ (x - self.mean) ** 2) / 2

    def slope(self, x: np.ndarray) -> np.ndarray:
        """The derivative of that."""
        return self.precision * (x - self.mean)


def prior_of(scene: Scene, names: list[str], asked: Priors) -> Prior | None:
    """The prior that a user asks for; None if there is none.

    Args:
        asked: name to (mean, sigma), each a number or one for each component.

    Raises:
        KeyError: the prior of a parameter that is not fitted.
        ValueError: it is not a pair of finite numbers of the parameter's size, or a sigma is not
            above 0.
    """
    if not isinstance(asked, Mapping):
        raise ValueError(f"priors: expected a dictionary of names and (mean, sigma), got {asked!r}")
    for name in asked:
        if name not in names:
            fitted = ", ".join(names)
            raise KeyError(
                f"priors: '{name}' is not among the parameters to fit; those are {fitted}"
            )
    if not asked:
        return None
    means, precisions = [], []
    for name in names:
        size = start_of(scene, name).size
        known = name in asked
        mean, sigma = _checked(name, asked[name], size) if known else (np.zeros(size), np.inf)
        means.append(mean)
        precisions.append(np.full(size, 1.0) / sigma**2)
    return Prior(np.concatenate(means), np.concatenate(precisions))


def _checked(name: str, pair: Any, size: int) -> tuple[np.ndarray, np.ndarray]:
    """The mean and the sigma of each number of a parameter."""
    try:
        mean, sigma = (np.broadcast_to(np.asarray(part, float), size) for part in pair)
    except (TypeError, ValueError):
        each = "numbers" if size == 1 else f"each a number or {size} of them"
        raise ValueError(f"priors: {name}: expected (mean, sigma), {each}, got {pair!r}") from None
    if not np.isfinite([mean, sigma]).all():
        raise ValueError(f"priors: {name}: expected finite numbers, got {pair!r}")
    if (sigma <= 0).any():
        raise ValueError(
            f"priors: {name}: expected a sigma > 0, got {pair!r}; leave out what is fixed from wrt"
        )
    return mean, sigma
