"""Nested tuples, dictionaries and dataclasses of arrays, taken apart and put together again."""

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

import drjit as dr

from .arrays import Array


class _Array:
    """Stands for an array in a structure."""


class Apart:
    """A value that has been taken apart, to be given to many functions. They get the value.

    Args:
        made: of a tuple, what they get instead of it.
    """

    def __init__(self, value: Any, made: Callable[[tuple], Any] | None = None) -> None:
        self.arrays: list[Array] = []
        self.structure = take_apart(value, self.arrays)
        if made is not None:
            self.structure = made, *self.structure[1:]  # type: ignore[index]


def take_apart(value: Any, arrays: list[Array]) -> Hashable:
    """The structure of a value, whose arrays are appended to a list.

    What is neither an array nor a container of some is a part of the structure, and must be
    hashable.
    """
    kind = type(value)
    if dr.is_array_v(kind):
        arrays.append(value)
        return _Array
    if kind is Apart:
        arrays += value.arrays
        return value.structure
    if kind is tuple:
        return kind, None, tuple([take_apart(part, arrays) for part in value])
    if kind is dict:
        return kind, tuple(value), tuple([take_apart(part, arrays) for part in value.values()])
    if is_dataclass(kind):
        names = _names(kind)
        return kind, names, tuple([take_apart(getattr(value, name), arrays) for name in names])
    return value


@cache
def _names(kind: Any) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))


def put_together(structure: Any, arrays: Iterator[Array]) -> Any:
    """The reverse of `take_apart`."""
    if structure is _Array:
        return next(arrays)
    if type(structure) is not tuple:
        return structure
    kind, names, parts = structure
    values = [put_together(part, arrays) for part in parts]
    return kind(values) if names is None else kind(**dict(zip(names, values, strict=True)))


def leaves(value: Any) -> list[Array]:
    """The arrays of a value, in order."""
    arrays: list[Array] = []
    take_apart(value, arrays)
    return arrays


def like(value: Any, arrays: Iterable[Array]) -> Any:
    """A value of the same structure with other arrays."""
    return put_together(take_apart(value, []), iter(arrays))
