"""Dr.Jit's derivatives: one thread at a time, and errors of our operation as they are.

Dr.Jit 1.5 has one lock for the graph of derivatives, and another for all arrays. Derivatives take
them in one order, and frozen functions in the other. So two threads could wait for each other
forever. Here `dr.backward` and its like get a lock that comes before both, and that `render` takes
as well.
"""

import threading
from collections.abc import Callable
from functools import wraps
from typing import Any

import drjit as dr

from .interrupts import held, interruptible

# Held by the thread that renders or differentiates
LOCK = threading.RLock()
STARTS = (
    *("traverse", "backward", "backward_from", "backward_to"),
    *("forward", "forward_from", "forward_to"),
)


class _Running(threading.local):
    """The calls of `STARTS` that a thread is in: the errors of each."""

    def __init__(self) -> None:
        self.errors: list[list[BaseException]] = []


_running = _Running()


def operation(method: Callable[[Any], None]) -> Callable[[Any], None]:
    """A method of an operation that Dr.Jit calls for a derivative.

    Dr.Jit would turn its errors into others. So what started the derivative raises them.
    """

    @wraps(method)
    def call(self: Any) -> None:
        if not _running.errors:
            with LOCK:
                return method(self)
        errors = _running.errors[-1]
        if not errors:
            try:
                interruptible(method, self)
            except BaseException as error:
                errors.append(error)
        return None

    return call


def _starting(function: Callable) -> Callable:
    """One of Dr.Jit's functions that start a derivative."""

    @wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        with LOCK:
            return held(_start, function, arguments, options)

    return call


def _start(function: Callable, arguments: tuple, options: dict[str, Any]) -> Any:
    errors: list[BaseException] = []
    _running.errors.append(errors)
    try:
        result = function(*arguments, **options)
    finally:
        _running.errors.pop()
        if errors:
            raise errors[0]
    return result


for _name in STARTS:
    setattr(dr, _name, _starting(getattr(dr, _name)))
