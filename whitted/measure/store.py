"""Times of calls that take turns, and a file that keeps what has been measured."""

import json
import statistics
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import drjit as dr

from ..files.atomic import write_text
from .timing import recorded

Rows = list[dict[str, Any]]


def in_turns(calls: Mapping[str, Callable[[], Any]], rounds: int) -> dict[str, dict[str, Any]]:
    """Times of calls, in milliseconds.

    Each is called once to compile its kernels, then all take turns, so that what slows the machine
    down slows all down.

    Returns:
        For each its value, the median time of the whole call ("ms"), half the range between its
        quartiles ("spread"), what its kernels took when it was called last ("kernel_ms"), seconds
        of compiling ("compile_s"), and how many operations the kernels compiled then hold
        ("operations").
    """
    found: dict[str, dict[str, Any]] = {}
    for name, call in calls.items():
        with recorded() as kernels:
            value = call()
            dr.eval(value)
            dr.sync_thread()
        found[name] = {
            "value": value,
            "compile_s": kernels.compile_seconds,
            "operations": kernels.operations,
        }
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            times[name].append(_clock(call))
    for name, call in calls.items():
        with recorded() as kernels:
            dr.eval(call())
            dr.sync_thread()
        quartiles = statistics.quantiles(times[name], n=4) if rounds > 1 else times[name] * 3
        found[name] |= {
            "ms": statistics.median(times[name]),
            "spread": (quartiles[2] - quartiles[0]) / 2,
            "kernel_ms": kernels.run_seconds * 1e3,
        }
    return found


def _clock(call: Callable[[], Any]) -> float:
    dr.sync_thread()
    start = time.perf_counter()
    dr.eval(call())
    dr.sync_thread()
    return (time.perf_counter() - start) * 1e3


class Store:
    """Measurements by group, kept in a JSON file, so that an interrupted run goes on where it was."""

    def __init__(self, path: Path, conditions: dict[str, Any]) -> None:
        self.path, self.conditions, self.groups = path, conditions, dict[str, Rows]()
        try:
            kept = json.loads(path.read_text(encoding="utf-8"))
            if kept["conditions"] == conditions:
                self.groups = kept["groups"]
        except (OSError, ValueError, KeyError, TypeError):
            pass  # nothing there, or nothing of ours

    def group(self, name: str, measure: Callable[[], Rows]) -> Rows:
        """A group of measurements: those kept, or new ones, which are kept then."""
        if name not in self.groups:
            self.groups[name] = measure()
            text = json.dumps({"conditions": self.conditions, "groups": self.groups}, indent=1)
            write_text(self.path, text)
        return self.groups[name]
