"""Functions whose kernels are recorded once and replayed later, without tracing the Python code.

Dr.Jit's `freeze` walks through arguments and results while it holds the lock of all its arrays. For
dataclasses and for comparisons it runs Python there. If another thread takes over just then, its
next work on an array waits for the lock, and both threads wait forever. So `freeze` is given a list
of arrays and nothing else; the rest is done before and after.

Recordings and kernels take memory. What was not used for longest is dropped first. Dr.Jit can free
kernels only all at once. A recording of which a kernel was freed, and then compiled again for
something else, would end the process: so all recordings go with the kernels.
"""

import gc
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, TypeVar
from weakref import WeakSet

import drjit as dr

from .arrays import Array
from .derivatives import LOCK
from .interrupts import held
from .pytree import put_together, take_apart

Result = TypeVar("Result")

# Recordings that are kept, of all functions together. An image with edges and its gradient take
# about 8, which hold 1 MiB
KEPT = 256
# Recordings that are made until kernels are freed. Those of 8 recordings take about 3 MiB
MADE = 512


_freeze = dr.freeze


class _Recording:
    """A function of arguments of one structure.

    Dr.Jit searches what a function captures for arrays; in this object it finds none.
    """

    def __init__(self, function: Callable, structure: Hashable) -> None:
        self.function = function
        self.arguments = structure
        self.result: Hashable = None
        self.used = 0  # the larger, the later
        self.replay: Any = _freeze(self._trace, state_fn=None, warn_after=1 << 30)

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
        _store.made += 1
        results: list[Array] = []
        self.result = take_apart(
            self.function(*put_together(self.arguments, iter(arrays))), results
        )
        return results


class _Store:
    """The recordings of all functions."""

    def __init__(self) -> None:
        self.by_function: list[dict[Hashable, _Recording]] = []
        self.uses = 0
        self.made = 0  # since kernels were freed
        # What users froze; kernels of their recordings must stay
        self.others: WeakSet[Any] = WeakSet()

    def make_room(self) -> None:
        """For one more recording: drop the one not used for longest, or all with their kernels."""
        if is_recording():
            return
        if self.made >= MADE:
            self.made = 0
            if not any(other.n_recordings for other in self.others):
                dr.flush_kernel_cache()
        self.drop(KEPT - 1)

    def drop(self, kept: int) -> None:
        """Drop all recordings but those last used."""
        entries = [(own, key) for own in self.by_function for key in own]
        entries.sort(key=lambda entry: entry[0][entry[1]].used, reverse=True)
        for own, key in entries[kept:]:
            own.pop(key).replay.clear()


_store = _Store()


def is_recording() -> bool:
    """Whether a kernel is being recorded, so that no array has numbers yet."""
    return bool(dr.flag(dr.JitFlag.SymbolicScope) or dr.flag(dr.JitFlag.FreezingScope))


def frozen(function: Callable[..., Result]) -> Callable[..., Result]:
    """Record the function for each structure of its arguments.

    Arguments are given by position. They and the results are made of tuples, dictionaries and
    dataclasses of arrays, and of values that can be hashed. Another such value is another
    recording; other arrays are not.
    """
    own: dict[Hashable, _Recording] = {}
    _store.by_function.append(own)

    @wraps(function)
    def call(*arguments: Any) -> Any:
        arrays: list[Array] = []
        structure = take_apart(arguments, arrays)
        with LOCK:
            recording = own.get(structure)
            if recording is None:
                held(_store.make_room)
                recording = own[structure] = _Recording(function, structure)
            _store.uses += 1
            recording.used = _store.uses
            return recording(arrays)

    return call


def _flushing(flush: Callable[[], None]) -> Callable[[], None]:
    """Dr.Jit's function that frees all kernels, for the package and for users."""

    @wraps(flush)
    def call() -> None:
        with LOCK:
            held(_store.drop, 0)
            dr.sync_thread()
            flush()

    return call


@wraps(_freeze)
def _noting(function: Callable | None = None, **options: Any) -> Any:
    """`dr.freeze` for users."""
    if function is None:
        return lambda function: _noting(function, **options)
    made: Any = _freeze(function, **options)
    _store.others.add(made)
    return made


_ours = {"freeze": _noting, "flush_kernel_cache": _flushing(dr.flush_kernel_cache)}
for _name, _function in _ours.items():
    setattr(dr, _name, _function)
