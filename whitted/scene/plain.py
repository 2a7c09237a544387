"""Numbers of any kind as Python's, which are what the tables of a scene file hold."""

from collections.abc import Mapping
from typing import Any

import drjit as dr
import numpy as np


def plain(value: Any) -> Any:
    """A value with Python's numbers and lists in place of NumPy's, of Dr.Jit's, and of tuples.

    An array that carries gradients stays as it is: no table holds it.
    """
    if dr.is_array_v(value):
        return value if dr.grad_enabled(value) else plain(value.numpy())
    if isinstance(value, np.ndarray):
        # A vector of Dr.Jit is a column here
        return value.squeeze().tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {key: plain(own) for key, own in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(own) for own in value]
    return value
