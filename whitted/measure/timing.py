"""Times: of kernels, from Dr.Jit's kernel history, and of whole calls, by the clock."""

import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import drjit as dr


@dataclass
class Kernels:
    """All kernels that ran in a `recorded` block."""

    operations: int = 0  # of the largest kernel
    compile_seconds: float = 0.0  # generating and compiling code, or loading it from the cache
    run_seconds: float = 0.0
    compiled: int = 0  # kernels that were in no cache


@contextmanager
def recorded() -> Iterator[Kernels]:
    """Record the kernels of the block; the result is filled when the block ends."""
    kernels = Kernels()
    dr.sync_thread()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        yield kernels
        dr.sync_thread()
        for entry in dr.kernel_history():
            milliseconds = entry.get("codegen_time", 0) + entry.get("backend_time", 0)
            kernels.compile_seconds += milliseconds / 1e3
            kernels.run_seconds += entry["execution_time"] / 1e3
            kernels.operations = max(kernels.operations, entry.get("operation_count", 0))
            kernels.compiled += "cache_hit" in entry and not entry["cache_hit"]


def in_turns(calls: Mapping[str, Callable[[], Any]], rounds: int) -> dict[str, dict[str, Any]]:
    """Time calls that take turns, so that a disturbance of the machine slows all of them.

    Each call runs once to compile its kernels, then `rounds` times by the clock, then once with
    its kernels timed.

    Args:
        calls: name to a function, whose result is evaluated as part of the call.
        rounds: timed runs of each call.

    Returns:
        For each name a dictionary: "value", the result of the first run; "compile_s", seconds of
        compiling; "operations", of the largest kernel; "ms", the median time of a whole call in
        milliseconds; "spread", half the interquartile range of these; "kernel_ms", the time of its
        kernels in the last run.
    """
    found: dict[str, dict[str, Any]] = {}
    for name, call in calls.items():
        value, kernels = _recorded_call(call)
        found[name] = {
            "value": value,
            "compile_s": kernels.compile_seconds,
            "operations": kernels.operations,
        }
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            times[name].append(_milliseconds(call))
    for name, call in calls.items():
        _, kernels = _recorded_call(call)
        quartiles = statistics.quantiles(times[name], n=4) if rounds > 1 else times[name] * 3
        found[name] |= {
            "ms": statistics.median(times[name]),
            "spread": (quartiles[2] - quartiles[0]) / 2,
            "kernel_ms": kernels.run_seconds * 1e3,
        }
    return found


def _recorded_call(call: Callable[[], Any]) -> tuple[Any, Kernels]:
    with recorded() as kernels:
        value = call()
        dr.eval(value)
    return value, kernels


def _milliseconds(call: Callable[[], Any]) -> float:
    dr.sync_thread()
    start = time.perf_counter()
    dr.eval(call())
    dr.sync_thread()
    return (time.perf_counter() - start) * 1e3
