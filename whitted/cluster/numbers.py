"""Single numbers of a scene by name: a parameter, a component of a vector, one of a cloud."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.arrays import Array
from ..core.parameter import Range
from ..inverse.bounds import shapes_of
from ..inverse.loss import arrays, label_of
from ..scene.scene import Scene


@dataclass(frozen=True)
class Number:
    """One number of a scene's parameters."""

    label: str  # such as "spheres.ball.center.x"
    name: str  # of the parameter
    place: tuple[int, ...]  # in the parameter's array: () of a number, (0,) of x

    def legal(self, scene: Scene) -> Range:
        return scene.locations[self.name].entry.legal


def numbers_named(scene: Scene, name: str) -> list[Number]:
    """The numbers that a name stands for: three for a vector, more for a pattern with `*`.

    Args:
        name: of a parameter, or of a component, as in "spheres.ball.center.x" and
            "clouds.beads.center.17.x".

    Raises:
        KeyError: the scene has no such parameter; the message lists the nearest.
    """
    for parts in range(3):
        stem, *rest = name.rsplit(".", parts)
        if stem in scene.locations:
            place = _place(rest, shapes_of(scene, [stem])[0])
            if place is not None:
                return [Number(label_of(stem, at), stem, at) for at in place]
    # This is a pattern, or it raises an error
    return [one for own in scene.parameters(name) for one in numbers_named(scene, own)]


def _place(words: list[str], shape: tuple[int, ...]) -> list[tuple[int, ...]] | None:
    """The places that the words behind a parameter's name stand for; None if there are none."""
    if not words:
        return list(np.ndindex(shape))
    if len(words) != len(shape):
        return None
    place = []
    for word, size in zip(words, shape, strict=True):
        index = "xyz".find(word) if len(word) == 1 and size == 3 and word in "xyz" else -1
        if word.isdecimal():
            index = int(word)
        if not 0 <= index < size:
            return None
        place.append(index)
    return [tuple(place)]


def with_values(scene: Scene, numbers: Sequence[Number], values: Iterable[float]) -> Scene:
    """The scene with other values of some numbers.

    Raises:
        ValueError: a value has no meaning for its parameter.
    """
    changed: dict[str, np.ndarray] = {}
    for number, value in zip(numbers, values, strict=True):
        if number.name not in changed:
            changed[number.name] = _current(scene, number.name)
        changed[number.name][number.place] = value
    return scene.replace(
        {name: value.tolist() if value.ndim < 2 else value for name, value in changed.items()}
    )


def _current(scene: Scene, name: str) -> np.ndarray:
    """A parameter's numbers: shape () of a number, (3,), (N,) or (N, 3)."""
    shape = shapes_of(scene, [name])[0]
    found = np.asarray(scene.parameters(name)[name].numpy(), np.float64)
    return found.T.reshape(shape).copy()


def tangents(scene: Scene, number: Number, names: Sequence[str]) -> dict[str, Array]:
    """The direction along a number, for all of some parameters."""
    shapes = zip(names, shapes_of(scene, list(names)), strict=True)
    units = {name: np.zeros(shape) for name, shape in shapes}
    units[number.name][number.place] = 1
    return arrays(scene, {name: unit.tolist() for name, unit in units.items()})


def check_values(scene: Scene, number: Number, values: Iterable[float]) -> None:
    """Refuse values that are not legal.

    Raises:
        ValueError: the message has the value, and what was expected.
    """
    legal = number.legal(scene)
    for value in values:
        if not (math.isfinite(value) and legal.holds(float(value))):
            expected = legal.expected(1, (value,)) or "a finite number"
            raise ValueError(f"{number.label}: expected {expected}, got {value:g}")
