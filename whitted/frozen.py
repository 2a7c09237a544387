"""Functions whose kernels are recorded once and then replayed, which skips tracing their Python code.

Dr.Jit's `freeze` walks through arguments and results while it holds the lock of all its arrays, and runs Python there:
for dataclasses, and to compare values. Should another thread's turn come just then, its next work on an array waits for
that lock, and both wait forever. So `freeze` is given a list of arrays alone; all else is done before and after.
"""

from collections.abc import Callable, Hashable, Iterator
from dataclasses import is_dataclass
from functools import wraps
from typing import Any, TypeVar

import drjit as dr

from .geometry import Array

Result = TypeVar("Result")


def frozen(function: Callable[..., Result]) -> Callable[..., Result]:
    """Record the function for each structure of its arguments.

    Arguments, by position, and results are made of tuples, dictionaries and dataclasses of arrays, and of values that
    can be hashed: another one is another recording.
    """
    recordings: dict[Hashable, _Recording] = {}

    @wraps(function)
    def call(*arguments: Any) -> Any:
        arrays: list[Array] = []
        structure = _take_apart(arguments, arrays)
        recording = recordings.get(structure)
        if recording is None:
            recording = recordings.setdefault(structure, _Recording(function, structure))
        return recording(arrays)

    return call


class _Recording:
    """A function of arguments of one structure. (Dr.Jit looks at it as at any captured value, and sees no array in it.)"""

    def __init__(self, function: Callable, structure: Hashable) -> None:
        self.function = function
        self.arguments = structure
        self.result: Hashable = None
        self.replay = dr.freeze(self._trace, state_fn=None, warn_after=1 << 30)

    def __call__(self, arrays: list[Array]) -> Any:
        results = self.replay(arrays)
        return _put_together(self.result, iter(results))

    def _trace(self, arrays: list[Array]) -> list[Array]:
        results: list[Array] = []
        self.result = _take_apart(self.function(*_put_together(self.arguments, iter(arrays))), results)
        return results


class _Array:
    """Stands for an array in a structure."""


def _take_apart(value: Any, arrays: list[Array]) -> Hashable:
    """The structure of a value, whose arrays are appended to a list."""
    kind = type(value)
    if dr.is_array_v(kind):
        arrays.append(value)
        return _Array
    if kind is tuple:
        return kind, None, tuple([_take_apart(part, arrays) for part in value])
    if kind is dict:
        return kind, tuple(value), tuple([_take_apart(part, arrays) for part in value.values()])
    if is_dataclass(kind):
        names = tuple(kind.__dataclass_fields__)
        return kind, names, tuple([_take_apart(getattr(value, name), arrays) for name in names])
    return value


def _put_together(structure: Any, arrays: Iterator[Array]) -> Any:
    """The reverse of `_take_apart`."""
    if structure is _Array:
        return next(arrays)
    if type(structure) is not tuple:
        return structure
    kind, names, parts = structure
    values = [_put_together(part, arrays) for part in parts]
    return kind(values) if names is None else kind(**dict(zip(names, values, strict=True)))
