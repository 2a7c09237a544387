"""Where further tries start: numbers moved at random, compared by pictures of plain samples.

Such pictures are cheap, as nothing is differentiated. Numbers of one parameter are moved, of one
object, or all.
"""

import math
from dataclasses import replace

import numpy as np

from .evolution import evolve
from .loss import Objective
from .search import Search

# Moves that are compared in each round, and how many of them go downhill
MOVES, BEST = 150, 4
# A move is a normal number times a scale times a power of two, of an exponent in this range
EXPONENTS = -2.5, 2.0
# The same of an evolution's first generation, and its pictures: so many a number, and once more
FIRST, PICTURES = (-3.0, 0.5), 150
# More numbers do not evolve, as the pictures would be too few; none moves by more scales than FAR
CROWD, FAR = 40, 8.0


class Moves:
    """Moves of numbers, at one resolution."""

    def __init__(
        self, search: Search, objective: Objective, start: np.ndarray, random: np.random.Generator
    ) -> None:
        """Prepare moves.

        Args:
            start: where the whole fit began.
        """
        self.search, self.start, self.random = search, start, random
        self.plain = replace(objective, options={**objective.options, "boundary": False})
        self.groups = groups_of(search.labels)

    def promising(self, x: np.ndarray) -> list[np.ndarray]:
        """The best of many moves, of which no two moved the same numbers; none if it is late."""
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

    def evolved(self, x: np.ndarray) -> list[np.ndarray]:
        """Where an evolution of some numbers leads, if that is lower than where they are."""
        which, base = self._base(x)
        count = int(which.sum())
        if count > CROWD:
            return self.promising(x)
        low = np.maximum(self.search.low, base - FAR * self.search.scale)
        high = np.minimum(self.search.high, base + FAR * self.search.scale)

        def moved(step: np.ndarray) -> np.ndarray:
            at = base.copy()
            at[which] += step * self.search.scale[which]
            return np.clip(at, low, high)

        before = self.plain.loss(x)
        loss, step = evolve(
            lambda step: self.plain.loss(moved(step)),
            count,
            2.0 ** self.random.uniform(*FIRST),
            PICTURES * (count + 1),
            self.random,
            lambda: self.search.late,
        )
        return [moved(step)] if loss < before else []

    def _move(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which numbers are moved, and all numbers after that."""
        which = self._group()
        size = self.search.scale * 2.0 ** self.random.uniform(*EXPONENTS)
        step = self.random.normal(size=len(x)) * size
        # Sometimes back to where the fit began, as a minimum may be far off
        base = self.start if self.random.random() < 0.3 else x
        moved = np.where(which, base + step, x)
        return which, np.clip(moved, self.search.low, self.search.high)

    def _base(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which numbers evolve, and all numbers before that.

        Half of the time the fit begins anew; else some numbers go on from where they are, or anew.
        """
        which = self._group()
        if self.random.random() < 0.5:
            return np.ones(len(x), bool), self.start
        return which, np.where(which, self.start, x) if self.random.random() < 0.5 else x

    def _group(self) -> np.ndarray:
        return self.groups[self.random.integers(len(self.groups))]


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
