"""The stress suite: which cases there are, running them, and what came of it."""

import difflib
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import PRECISIONS
from . import edges, images, input, optics, paths, rays
from .case import Case, Check

MODULES = (rays, optics, paths, images, edges, input)
CASES: tuple[Case, ...] = tuple(
    sorted((case for module in MODULES for case in module.CASES), key=lambda case: case.number)
)


@dataclass(frozen=True)
class Result:
    """What a case gave in one precision."""

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
        return max(self.checks, key=lambda check: (not check.passed, check.share))


def choose(names: Sequence[str], cases: Sequence[Case] = CASES) -> list[Case]:
    """The cases of these numbers or names, in the suite's order; all without any.

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
            slugs = [slug(case) for case in cases]
            near = difflib.get_close_matches(key, slugs, n=3, cutoff=0.4)
            told = f"nearest: {', '.join(near)}" if near else f"there are {', '.join(slugs)}"
            raise ValueError(
                f"there is no stress case '{name}'; {told}; or a number from {cases[0].number} to {cases[-1].number}"
            )
        wanted.append(known[key])
    return [case for case in cases if case in wanted] if names else list(cases)


def slug(case: Case) -> str:
    return case.name.lower().replace(" ", "-")


def run(
    cases: Iterable[Case], report: Callable[[Result], None] = lambda result: None
) -> list[Result]:
    """Run cases in both precisions.

    Args:
        report: called with each result as it comes.

    Returns:
        A result for each case and precision; a case that raises fails with what it said.
    """
    results = []
    for case in cases:
        for precision in PRECISIONS:
            start, checks = time.perf_counter(), []
            try:
                for check in case.checks(precision):
                    checks.append(check)
            except (
                Exception
            ) as error:  # whatever a case does wrong is its own failure, and not that of the suite
                checks.append(Check(f"{type(error).__name__}: {error}", np.nan, 0))
            results.append(Result(case, precision.name, tuple(checks), time.perf_counter() - start))
            report(results[-1])
    return results


def line(result: Result) -> str:
    """A result as a line of the table, of the check that is nearest to its bound; each failed check
    has one of its own.
    """
    case = f"{result.case.number:>3} {result.case.name:24} {result.precision:6}"
    failed = [check for check in result.checks if not check.passed] or [result.tightest]
    return "\n".join(
        f"{case} {check.error:9.2e} {check.bound:9.2e} {'pass' if check.passed else 'FAIL'}  {check.what}"
        for check in failed
    )


HEADER = f"{'':>3} {'case':24} {'':6} {'error':>9} {'bound':>9} {'':4}  of the check nearest to its bound"
