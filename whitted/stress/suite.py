"""The stress suite: its cases, and running them."""

import difflib
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import PRECISIONS
from . import (
    edges,
    glass_sphere,
    input,
    interface,
    media,
    mirrors,
    origins,
    photon,
    placement,
    rays,
    small_edges,
    transforms,
)
from .case import Case, Check

MODULES = (
    rays,
    origins,
    transforms,
    interface,
    glass_sphere,
    mirrors,
    photon,
    media,
    placement,
    edges,
    small_edges,
    input,
)
CASES: tuple[Case, ...] = tuple(
    sorted((case for module in MODULES for case in module.CASES), key=lambda case: case.number)
)


@dataclass(frozen=True)
class Result:
    """The checks of a case in one precision."""

    case: Case
    precision: str
    checks: tuple[Check, ...]
    seconds: float

    @property
    def passed(self) -> bool:
        return bool(self.checks) and all(check.passed for check in self.checks)

    @property
    def tightest(self) -> Check:
        """The check that is nearest to its bound, or farthest beyond it."""
        return max(self.checks, key=lambda check: (not check.passed, check.ratio))


def choose(names: Sequence[str], cases: Sequence[Case] = CASES) -> list[Case]:
    """The cases of these numbers or names, in the suite's order; all if there are none.

    Args:
        names: numbers, or names with spaces or hyphens between words.

    Raises:
        ValueError: there is no such case; the message lists the nearest names.
    """
    known = {key: case for case in cases for key in (str(case.number), slug(case))}
    wanted = []
    for name in names:
        key = name.strip().lower().replace(" ", "-")
        if key not in known:
            raise ValueError(_no_such_case(name, key, cases))
        wanted.append(known[key])
    return [case for case in cases if case in wanted] if names else list(cases)


def _no_such_case(name: str, key: str, cases: Sequence[Case]) -> str:
    slugs = [slug(case) for case in cases]
    near = difflib.get_close_matches(key, slugs, n=3, cutoff=0.4)
    names = f"nearest: {', '.join(near)}" if near else f"there are {', '.join(slugs)}"
    numbers = f"a number from {cases[0].number} to {cases[-1].number}"
    return f"there is no stress case '{name}'; {names}; or {numbers}"


def slug(case: Case) -> str:
    """A case's name for files and the command line, such as "ball-lens"."""
    return case.name.lower().replace(" ", "-")


def run(
    cases: Iterable[Case], report: Callable[[Result], None] = lambda result: None
) -> list[Result]:
    """Run cases in both precisions.

    Args:
        report: called with each result as it is found.

    Returns:
        A result for each case and precision. A case that raises an exception has a failed check of
        the exception's message.
    """
    results = []
    for case in cases:
        for precision in PRECISIONS:
            start, checks = time.perf_counter(), []
            try:
                for check in case.checks(precision):
                    checks.append(check)
            # Whatever a case raises is its own failure, and must not end the suite
            except Exception as error:
                checks.append(Check(f"{type(error).__name__}: {error}", np.nan, 0))
            results.append(Result(case, precision.name, tuple(checks), time.perf_counter() - start))
            report(results[-1])
    return results


NAME_WIDTH = max(len(case.name) for case in CASES)
HEADER = (
    f"{'':>3} {'case':{NAME_WIDTH}} {'':6} {'error':>9} {'bound':>9} {'':4}  "
    "of the check nearest to its bound"
)


def line(result: Result) -> str:
    """A line of the table under `HEADER`, or one for each failed check."""
    case = f"{result.case.number:>3} {result.case.name:{NAME_WIDTH}} {result.precision:6}"
    failed = [check for check in result.checks if not check.passed] or [result.tightest]
    return "\n".join(
        f"{case} {check.error:9.2e} {check.bound:9.2e} "
        f"{'pass' if check.passed else 'FAIL'}  {check.what}"
        for check in failed
    )
