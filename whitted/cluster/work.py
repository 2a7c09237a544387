"""What a run's tasks share, and how one task is done on a worker, or here.

Task functions are functions of modules, `function(shared, task)`: a function of `__main__` would be
pickled with all that it refers to. What tasks share is pickled once, and opened once in each
process.
"""

import errno
import hashlib
import pickle
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

# Called with what the tasks of a run share, and with a task
Function = Callable[[Any, Any], Any]
# How often a task is tried
ATTEMPTS = 3
# What every other task would meet, too: a full disk, one that cannot be written to or is not there
STOPPING = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOENT}

_lock = threading.Lock()
_opened: dict[str, Any] = {}


@dataclass(frozen=True)
class Packed:
    """What all tasks of a run share, pickled."""

    key: str
    data: bytes = field(repr=False)

    @staticmethod
    def of(shared: Any) -> "Packed":
        data = pickle.dumps(shared)
        return Packed(hashlib.sha256(data).hexdigest(), data)

    def open(self) -> Any:
        """What was pickled; one run's is kept."""
        with _lock:
            if self.key not in _opened:
                _opened.clear()
                _opened[self.key] = pickle.loads(self.data)
            return _opened[self.key]


@dataclass(frozen=True)
class Outcome:
    """How a task has ended."""

    task: Any
    value: Any = None
    error: str | None = None  # why it failed, if it did


def perform(task: Any, function: Function, packed: Packed) -> Any:
    """Do a task."""
    return function(packed.open(), task)


def same(packed: Packed) -> Packed:
    """A task whose result other tasks take: Dask makes it anew where a worker with it has died."""
    return packed


def stops(error: BaseException) -> bool:
    """Whether an error ends a run, as all other tasks would meet it."""
    return isinstance(error, OSError) and error.errno in STOPPING


def told(error: BaseException) -> str:
    """An error in one line."""
    lines = str(error).splitlines()
    kind = type(error).__name__
    if isinstance(error, ValueError) and lines:
        return lines[0]
    return f"{kind}: {lines[0]}" if lines else kind


def at_the_third_attempt(function: Function, packed: Packed, task: Any) -> Outcome:
    """Do a task here; one that fails is tried again.

    Raises:
        OSError: the run has to stop.
    """
    error: Exception | None = None
    for _ in range(ATTEMPTS):
        try:
            return Outcome(task, perform(task, function, packed))
        except Exception as caught:
            if stops(caught):
                raise
            error = caught
    assert error is not None
    return Outcome(task, error=told(error))
