"""Ctrl-C. It raises `KeyboardInterrupt` only where that goes through.

Dr.Jit turns every exception of the Python code that it calls into a `RuntimeError`. So a handler of
ours stands before the one that was there. Where Dr.Jit is at work it keeps the signal, and passes
it on as soon as Dr.Jit has returned.
"""

import signal
import threading
from collections.abc import Callable
from functools import wraps
from types import FrameType
from typing import Any, ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class _Handler:
    """Passes signals on to another handler, but not while `held` runs."""

    kept = False  # a signal waits; two that wait are one

    def __init__(self, other: Callable[[int, FrameType | None], Any]) -> None:
        self.other = other

    def __call__(self, number: int, frame: FrameType | None) -> Any:
        if _is_held(frame):
            _Handler.kept = True
            return None
        _Handler.kept = False
        return self.other(number, frame)


def heed() -> None:
    """Put our handler before Python's, or before the user's.

    It is left there. A signal that is ignored, or that ends the process, stays so.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    now = signal.getsignal(signal.SIGINT)
    if callable(now) and not isinstance(now, _Handler):
        signal.signal(signal.SIGINT, _Handler(now))


def held(function: Callable[..., Result], *arguments: Any, **options: Any) -> Result:
    """Call a function that Ctrl-C does not interrupt; a signal is passed on at the end."""
    try:
        return _holding(function, *arguments, **options)
    finally:
        pass_on()


def interruptible(function: Callable[..., Result], *arguments: Any, **options: Any) -> Result:
    """Within `held`: call a function that Ctrl-C does interrupt, also if it came before."""
    return _letting(function, *arguments, **options)


def pass_on() -> None:
    """Raise what a signal that waits was to raise, if it may be raised here."""
    if _Handler.kept and threading.current_thread() is threading.main_thread():
        _Handler.kept = False
        signal.raise_signal(signal.SIGINT)


def forget() -> bool:
    """Whether a signal waits; it is not passed on."""
    waits, _Handler.kept = _Handler.kept, False
    return waits


def insist(function: Callable[[], Result], interrupted: bool = False) -> tuple[Result, bool]:
    """Within `held`: call an interruptible function, and again after a first Ctrl-C.

    Args:
        interrupted: there was a first one before; the next is raised.

    Returns:
        The function's result, and whether there was a Ctrl-C.
    """
    try:
        return interruptible(function), interrupted
    except KeyboardInterrupt:
        if interrupted:
            raise
        return interruptible(function), True


def holding(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """A function that is called by `held`."""

    @wraps(function)
    def call(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        heed()
        return held(function, *arguments, **options)

    return call


# The frames of these two are looked for


def _holding(function: Callable[..., Result], *arguments: Any, **options: Any) -> Result:
    return function(*arguments, **options)


def _letting(function: Callable[..., Result], *arguments: Any, **options: Any) -> Result:
    pass_on()
    return function(*arguments, **options)


def _is_held(frame: FrameType | None) -> bool:
    """Whether the innermost of the two is `_holding`."""
    while frame is not None:
        if frame.f_code is _holding.__code__:
            return True
        if frame.f_code is _letting.__code__:
            return False
        frame = frame.f_back
    return False
