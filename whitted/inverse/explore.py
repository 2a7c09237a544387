"""Further tries, where a descent has ended in a minimum that does not explain the pictures.

Numbers are moved at random: those of one parameter, of one object, or all. Many moves are compared
by pictures of plain samples, which are cheap. The best ones go downhill; a move that ends lower
than all before is where the next moves start. In every other round at the coarsest resolution, where
such pictures are cheapest, moves evolve by generations (`evolution.py`).

Source: D. Wales, J. Doye, "Global Optimization by Basin-Hopping" (1997).
"""

import itertools
import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from .evolution import evolve
from .loss import Objective
from .quality import assess
from .search import Search

Descent = Callable[[Search, Objective, np.ndarray, int, int], tuple[np.ndarray, str]]
Starts = Callable[[np.ndarray], list[np.ndarray]]

# Moves that are compared in each round, and how many of them go downhill
MOVES, BEST = 150, 4
# A move is a normal number times a scale times a power of two, of an exponent in this range
EXPONENTS = -2.5, 2.0
# The deviation of a first generation is a scale times a power of two, of an exponent in this range;
# so many pictures are drawn for each number, and once more
FIRST, PICTURES = (-3.0, 0.5), 150
EVOLVED = 2
# Evolution moves no more than so many numbers, and no number by more than so many scales
CROWD, FARTHEST = 40, 8.0
# Rounds without a better minimum before what a robust loss leaves is believed
PATIENCE = 3


@dataclass(frozen=True)
class End:
    """The end of a descent."""

    loss: float
    x: np.ndarray
    stopped: str  # why


@dataclass
class Explorer:
    """Moves from minimum to minimum, at one resolution."""

    search: Search
    objective: Objective
    descend: Descent
    iterations: tuple[int, int]  # of a try, and of one that leads lower than all before
    level: int
    coarsest: bool
    start: np.ndarray  # where the whole fit began
    random: np.random.Generator

    def __post_init__(self) -> None:
        self.plain = replace(self.objective, options={**self.objective.options, "boundary": False})
        self.groups = groups_of(self.search.labels)

    def run(self, x: np.ndarray, stopped: str, seconds: float) -> tuple[np.ndarray, str]:
        """The best numbers found, from a minimum on; ends early if they explain the pictures.

        A robust loss explains much. With it, some rounds must have found nothing better as well.

        Args:
            stopped: why the descent to the minimum ended.

        Returns:
            The numbers, and why the descent to them ended.
        """
        outer, best, idle = self.search.deadline, End(self.objective.loss(x), x, stopped), 0
        explained = assess(self.objective, x).explained
        patience = PATIENCE if self.objective.robust else 0
        self.search.deadline = min(outer, time.monotonic() + seconds)
        kinds = [self._promising, *[self._evolved] * (EVOLVED if self.coarsest else 0)]
        rounds = itertools.cycle(kinds)
        while not (self.search.late or (explained and idle >= patience)):
            better = self._round(best, next(rounds))
            idle += 1
            if better is not None:
                best, idle = better, 0
                explained = assess(self.objective, best.x).explained
        self.search.deadline = outer
        # The history goes on from the best, not from the last try
        self.search.record(self.objective, best.loss, best.x)
        if not explained and self.level == 0:
            self.search.notes.append("further tries ended with the budget; give more, or bounds")
        return best.x, best.stopped

    def _round(self, best: End, starts: Starts) -> End | None:
        """A minimum that is lower than the best, if some of the starts lead to one."""
        found = best
        for start in starts(best.x):
            self.search.attempt += 1
            # A try may leave what is finite
            with suppress(ValueError):
                tried = self._descent(start, self.iterations[0])
                found = min(found, tried, key=lambda one: one.loss)
            if self.search.late:
                return None if found is best else found
        return None if found is best else self._descent(found.x, self.iterations[1])

    def _descent(self, start: np.ndarray, iterations: int) -> End:
        """Where a descent ends."""
        x, stopped = self.descend(self.search, self.objective, start, iterations, self.level)
        return End(self.objective.loss(x), x, stopped)

    def _promising(self, x: np.ndarray) -> list[np.ndarray]:
        """The best of many moves, of which no two moved the same numbers."""
        chosen: dict[bytes, tuple[float, np.ndarray]] = {}
        for _ in range(MOVES):
            if self.search.late:
                return []
            which, moved = self._move(x)
            loss = self.plain.loss(moved)
            key = which.tobytes()
            if math.isfinite(loss) and (key not in chosen or loss < chosen[key][0]):
                chosen[key] = loss, moved
        ordered = sorted(chosen.values(), key=lambda pair: pair[0])
        return [moved for _, moved in ordered[:BEST]]

    def _move(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which numbers are moved, and all numbers after that."""
        which = self._group()
        size = self.search.scale * 2.0 ** self.random.uniform(*EXPONENTS)
        step = self.random.normal(size=len(x)) * size
        # Sometimes back to where the fit began, as a minimum may be far off
        base = self.start if self.random.random() < 0.3 else x
        moved = np.where(which, base + step, x)
        return which, np.clip(moved, self.search.low, self.search.high)

    def _group(self) -> np.ndarray:
        return self.groups[self.random.integers(len(self.groups))]

    def _evolved(self, x: np.ndarray) -> list[np.ndarray]:
        """Where the evolution of some numbers leads, or of all."""
        which, base = self._group(), x
        if self.random.random() < 0.5:
            which, base = np.ones(len(x), bool), self.start
        elif self.random.random() < 0.5:
            base = np.where(which, self.start, x)
        count = int(which.sum())
        if count > CROWD:
            return []
        far = FARTHEST * self.search.scale
        low, high = (np.maximum(self.search.low, base - far), np.minimum(self.search.high, base + far))

        def moved(step: np.ndarray) -> np.ndarray:
            at = base.copy()
            at[which] += step * self.search.scale[which]
            return np.clip(at, low, high)

        best = evolve(
            lambda step: self.plain.loss(moved(step)),
            2.0 ** self.random.uniform(*FIRST),
            count,
            PICTURES * (count + 1),
            self.random,
            lambda: self.search.late,
        )
        end = moved(best)
        return [end] if self.plain.loss(end) < self.plain.loss(x) else []


def groups_of(labels: list[str]) -> list[np.ndarray]:
    """Sets of numbers that are moved together, as masks: each parameter, each object, and all."""
    parameters = [_stem(label) for label in labels]
    objects = [name.rpartition(".")[0] for name in parameters]
    masks = {}
    for keys in (parameters, objects, ["all"] * len(labels)):
        for key in dict.fromkeys(keys):
            mask = np.array([other == key for other in keys])
            masks[mask.tobytes()] = mask
    return list(masks.values())


def _stem(label: str) -> str:
    """The parameter of a number."""
    stem, _, last = label.rpartition(".")
    return stem if last in ("x", "y", "z") else label
