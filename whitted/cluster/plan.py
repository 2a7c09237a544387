"""What a sweep is: a scene, the values of its numbers, how pictures are rendered, and its tasks."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from typing import Any

import numpy as np

from ..scene.scene import Scene
from .numbers import Number, check_values, numbers_named
from .samplers import SAMPLERS, Axis, Samples, sides

# Samples of the pictures of a task: at least so many, if there are as many. That is half a second.
# A task costs 10 to 20 ms beside its pictures, most of it for its chunk (benchmarks/cluster.py)
LEAST = 3 << 19
# And at most so many, so that a task ends soon, and its pictures fit in memory
MOST = 1 << 22
# However small, a picture takes as long as so many samples, and so does each derivative
OVERHEAD = 1 << 13
# Tasks that a sweep is cut into where pictures are few, so that all workers have some
TASKS = 64
# More pictures are refused, and so are more tasks
MOST_PICTURES = 1 << 31
# The way in which a store is laid out
LAYOUT = 1
# Pictures may differ between versions of these
PACKAGES = ("whitted", "drjit")


@dataclass(frozen=True)
class Plan:
    """A sweep."""

    scene: Scene
    numbers: tuple[Number, ...]
    samples: Samples
    derivatives: tuple[Number, ...]
    resolution: tuple[int, int]
    spp: int
    boundary: bool
    max_depth: int
    batch: int  # pictures of a task

    @property
    def count(self) -> int:
        return self.samples.count

    @property
    def tasks(self) -> int:
        return -(-self.count // self.batch)

    def pictures(self, task: int) -> tuple[int, int]:
        """The first picture of a task, and how many it has."""
        first = task * self.batch
        return first, min(self.batch, self.count - first)

    @property
    def options(self) -> dict[str, Any]:
        """The options of `render`."""
        return {
            "spp": self.spp,
            "boundary": self.boundary,
            "max_depth": self.max_depth,
            "resolution": self.resolution,
        }

    def described(self) -> dict[str, Any]:
        """All that decides about a store's bytes, for its attributes."""
        return {
            "layout": LAYOUT,
            **{package: metadata.version(package) for package in PACKAGES},
            "scene": digest(self.scene),
            # In order: the sampler gives each number the values of its place
            "vary": [[axis.label, *_told(axis)] for axis in self.samples.axes],
            "sampler": self.samples.sampler,
            "count": self.count,
            "seed": self.samples.seed,
            "precision": self.scene.precision.name,
            "resolution": list(self.resolution),
            "spp": self.spp,
            "boundary": self.boundary,
            "max_depth": self.max_depth,
            "derivatives": [number.label for number in self.derivatives],
            "batch": self.batch,
        }


def digest(scene: Scene) -> str:
    """A digest of a scene's tables."""
    return hashlib.sha256(json.dumps(scene.to_dict(), sort_keys=True).encode()).hexdigest()


def _told(axis: Axis) -> list[Any]:
    """What a number is drawn from, in few words."""
    if axis.values is None:
        return [axis.low, axis.high]
    digest = hashlib.sha256(np.asarray(axis.values, np.float64).tobytes()).hexdigest()
    return [f"{len(axis.values)} values", digest[:12]]


def batch_of(count: int, samples: int, derivatives: int) -> int:
    """How many pictures a task has.

    Args:
        count: of all pictures.
        samples: of one picture.
        derivatives: of each picture.
    """
    cost = (samples + OVERHEAD) * (1 + derivatives)
    least, most = (max(1, bound // cost) for bound in (LEAST, MOST))
    # A power of two, by which few chunks have an odd size
    return int(min(max(least, 1 << int(math.log2(max(1, count // TASKS)))), most))


def samples_of(
    scene: Scene, vary: Mapping[str, Any], sampler: str, count: int | None, seed: int
) -> tuple[tuple[Number, ...], Samples]:
    """The numbers that are varied, and their values.

    Args:
        vary: name to (low, high), to a list of values, or to a function of a NumPy generator and
            the count that draws them.

    Raises:
        KeyError: the scene has no such parameter.
        ValueError: a range that is not legal, or another bad argument.
    """
    if sampler not in SAMPLERS:
        raise ValueError(f"sampler: expected one of {', '.join(SAMPLERS)}, got {sampler!r}")
    if not isinstance(vary, Mapping) or not vary:
        raise ValueError(
            "vary: expected a dictionary such as {'materials.glass.ior': (1.3, 1.8)}, "
            f"got {vary!r}"
        )
    if count is not None and not (is_whole(count) and count >= 1):
        raise ValueError(f"count: expected a whole number from 1 on, got {count!r}")
    if not (is_whole(seed) and seed >= 0):
        raise ValueError(f"seed: expected a whole number from 0 on, got {seed!r}")
    numbers: list[Number] = []
    axes: list[Axis] = []
    for name, given in vary.items():
        if not isinstance(name, str):
            raise ValueError(f"vary: expected the name of a parameter, got {name!r}")
        for number in numbers_named(scene, name):
            if number.label in {axis.label for axis in axes}:
                raise ValueError(f"vary: '{number.label}' is named twice")
            if "/" in number.label:
                raise ValueError(
                    f"vary: '{number.label}' cannot be the name of an array, for its '/'; rename "
                    "the thing in the scene"
                )
            axis = _axis(scene, number, given, count, seed + len(axes))
            numbers.append(number)
            axes.append(axis)
    pictures = _count(axes, sampler, count)
    if pictures > MOST_PICTURES:
        raise ValueError(
            f"count: {pictures} pictures are more than 2^31; give fewer, or cut the sweep into "
            "several"
        )
    samples = Samples(tuple(axes), sampler, pictures, int(seed))
    return tuple(numbers), samples


def is_whole(value: object) -> bool:
    """Whether a value is a whole number of Python or NumPy."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _axis(scene: Scene, number: Number, given: Any, count: int | None, seed: int) -> Axis:
    """What a number is drawn from."""
    drawn = callable(given)
    if drawn:
        if count is None:
            raise ValueError(f"count: say how many values of {number.label} are to be drawn")
        given = given(np.random.default_rng(seed), count)
    try:
        values = np.asarray(given, np.float64)
    except (TypeError, ValueError):
        values = np.zeros((0, 0))
    if values.ndim != 1 or not values.size:
        raise ValueError(
            f"{number.label}: expected (low, high) or a list of numbers, got {given!r}"
        )
    check_values(scene, number, values)
    if isinstance(given, tuple) and len(given) == 2 and not drawn:
        low, high = values.tolist()
        if low > high:
            raise ValueError(f"{number.label}: the lowest, {low:g}, is above the highest, {high:g}")
        return Axis(number.label, low, high)
    return Axis(number.label, values=tuple(values.tolist()))


def _count(axes: list[Axis], sampler: str, count: int | None) -> int:
    """How many pictures there are."""
    lengths = {axis.label: len(axis.values) for axis in axes if axis.values is not None}
    if sampler == "grid":
        if count is None:
            if len(lengths) < len(axes):
                raise ValueError("count: say how many pictures a grid over ranges has")
            count = math.prod(lengths.values())
        sides(tuple(axes), count)
        return int(count)
    if count is None:
        if not lengths:
            raise ValueError("count: say how many pictures there are to be")
        count = next(iter(lengths.values()))
    for label, length in lengths.items():
        if length != count:
            raise ValueError(
                f"{label}: has {length} values for {count} pictures; give one for each, "
                "or take the sampler grid"
            )
    return int(count)
