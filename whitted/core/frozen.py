"""Functions whose kernels are recorded once and replayed later, without tracing the Python code.

Dr.Jit's `freeze` walks through arguments and results while it holds the lock of all its arrays. For
dataclasses and for comparisons it runs Python there. If another thread takes over just then, its
next work on an array waits for the lock, and both threads wait forever. So `freeze` is given a list
of arrays and nothing else; the rest is done before and after.
"""

import gc
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, TypeVar

import drjit as dr

from .arrays import Array
from .interrupts import held
from .pytree import put_together, take_apart

Result = TypeVar("Result")


def frozen(function: Callable[..., Result]) -> Callable[..., Result]:
    """Record the function for each structure of its arguments.

    Arguments are given by position. They and the results are made of tuples, dictionaries and
    dataclasses of arrays, and of values that can be hashed. Another such value is another
    recording; other arrays are not.
    """
    recordings: dict[Hashable, _Recording] = {}

    @wraps(function)
    def call(*arguments: Any) -> Any:
        arrays: list[Array] = []
        structure = take_apart(arguments, arrays)
        recording = recordings.get(structure)
        if recording is None:
            recording = recordings.setdefault(structure, _Recording(function, structure))
        return recording(arrays)

    return call


class _Recording:
    """A function of arguments of one structure.

    Dr.Jit searches what a function captures for arrays; in this object it finds none.
    """

    def __init__(self, function: Callable, structure: Hashable) -> None:
        self.function = function
        self.arguments = structure
        self.result: Hashable = None
        self.replay = dr.freeze(self._trace, state_fn=None, warn_after=1 << 30)

    def __call__(self, arrays: list[Array]) -> Any:
        results = held(self._replay, arrays)
        return put_together(self.result, iter(results))

    def _replay(self, arrays: list[Array]) -> list[Array]:
        # Freeing an array in NumPy's memory while Dr.Jit records would end the process. The garbage
        # collector may do that at any time
        collects = gc.isenabled()
        gc.disable()
        try:
            results: list[Array] = self.replay(arrays)
        finally:
            if collects:
                gc.enable()
        return results

    def _trace(self, arrays: list[Array]) -> list[Array]:
        results: list[Array] = []
        self.result = take_apart(
            self.function(*put_together(self.arguments, iter(arrays))), results
        )
        return results
