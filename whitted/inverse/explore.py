"""Further tries, where a descent has ended in a minimum that does not explain the pictures.

Rounds of tries follow each other. In some, many moves at random are compared, and the best ones go
downhill. In the others, which there are only at the coarsest resolution, where pictures are
cheapest, moves evolve (`evolution.py`). A try that ends lower than all before is where the next
round starts.

Source: D. Wales, J. Doye, "Global Optimization by Basin-Hopping" (1997).
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import cycle

import numpy as np

from .loss import Objective
from .moves import Moves
from .quality import assess
from .search import Search

Descent = Callable[[Search, Objective, np.ndarray, int, int], tuple[np.ndarray, str]]
Starts = Callable[[np.ndarray], list[np.ndarray]]

# Rounds in which moves evolve, after each in which they are compared. Evolution finds most of what
# is far away; comparison costs less, and finds most of what is near
EVOLVED = 3
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
    moves: Moves
    coarsest: bool

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
        evolved = [self.moves.evolved] * (EVOLVED if self.coarsest else 0)
        rounds = cycle([self.moves.promising, *evolved])
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
