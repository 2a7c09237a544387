"""A scene's parameters by name: where each one is, what may take its place, and its numbers."""

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array, precision_of
from ..core.host import from_numbers
from ..core.parameter import LARGEST, OVERSTEP, Numbers, Parameter, parameters_of
from .plain import plain


@dataclass(frozen=True)
class Location:
    """Where in a scene a parameter is."""

    field: str  # of the scene
    place: int | None  # in the field, if that is a tuple of things
    path: tuple[str, ...]  # fields from there on
    entry: Parameter

    def read(self, scene: Any) -> Array:
        """The parameter's array."""
        value = getattr(scene, self.field)
        value = value if self.place is None else value[self.place]
        for name in self.path:
            value = getattr(value, name)
        return value


def locations_in(
    thing: Any, prefix: str, whole: str, place: int | None = None, path: tuple[str, ...] = ()
) -> Iterator[tuple[str, Location]]:
    """Names and locations of a thing's parameters, and of those of the things within it.

    Args:
        prefix: the beginning of the names.
        whole, place, path: where the thing itself is: `Location`'s field, place and path.
    """
    for name, entry in parameters_of(type(thing)).items():
        yield f"{prefix}.{name}", Location(whole, place, (*path, name), entry)
    for field in fields(thing):
        part, inner = getattr(thing, field.name), (*path, field.name)
        if is_dataclass(part):
            yield from locations_in(part, f"{prefix}.{field.name}", whole, place, inner)


def with_values(thing: Any, values: Mapping[tuple[str, ...], Array]) -> Any:
    """A copy of a thing with other arrays, by the path to each."""
    changes: dict[str, Any] = {}
    inner: dict[str, dict[tuple[str, ...], Array]] = {}
    for (field, *rest), value in values.items():
        if rest:
            inner.setdefault(field, {})[tuple(rest)] = value
        else:
            changes[field] = value
    changes |= {field: with_values(getattr(thing, field), own) for field, own in inner.items()}
    return replace(thing, **changes)


def check_names(names: Iterable[str], known: Mapping[str, object]) -> None:
    """Refuse names that are not known.

    Raises:
        KeyError: the message lists the nearest names, or says that patterns are not taken.
    """
    for name in names:
        if name not in known:
            if "*" in str(name) and _matching(name, known):
                raise KeyError(
                    f"'{name}' is a pattern, and names are expected here; give each name, as in "
                    f"dict.fromkeys(scene.parameters('{name}'), value)"
                )
            whole, _, component = str(name).rpartition(".")
            if component in ("x", "y", "z") and whole in known:
                raise KeyError(f"'{name}' is a component; name the whole parameter, '{whole}'")
            near = difflib.get_close_matches(str(name), known, n=3, cutoff=0.5) or list(known)[:3]
            raise KeyError(f"the scene has no parameter '{name}'; nearest: {', '.join(near)}")


def _matching(pattern: str, known: Iterable[str]) -> list[str]:
    """The names that a pattern stands for."""
    form = re.compile(".*".join(map(re.escape, pattern.split("*"))))
    return [each for each in known if form.fullmatch(each)]


def chosen_names(names: Iterable[str], known: Mapping[str, object]) -> list[str]:
    """The names that are known, or all of them without any; `*` stands for any part of a name.

    Raises:
        KeyError: one is not known, or none matches; the message lists the nearest names.
        TypeError: one is no string.
    """
    chosen: dict[str, None] = {}
    for name in names:
        if not isinstance(name, str):
            raise TypeError(
                f"expected a name, as in 'spheres.ball.center', got a {type(name).__name__}; "
                "parameters takes several as arguments of their own"
            )
        matching = [name]
        if name not in known and "*" in str(name):
            matching = _matching(name, known) or matching
        check_names(matching, known)
        chosen |= dict.fromkeys(matching)
    return list(chosen or known)


def remedy_of(values: Mapping[str, Any]) -> str:
    """What to do about values that have no meaning, as the end of a message. Arrays of Dr.Jit may
    come from an optimiser.
    """
    stepped = any(value is not None and dr.is_jit_v(value) for value in values.values())
    return "; bound the steps of the optimiser" if stepped else ""


def as_parameter(name: str, value: Any, old: Array, many: bool) -> Array:
    """A value as an array of the old one's type.

    Args:
        many: the parameter has a number, or a vector, for each sphere of a cloud.

    Raises:
        ValueError: it is not one number, or not one vector, or not so many, as the old one is.
    """
    if many:
        return _as_many(name, value, old)
    want, size = ("one vector of three numbers", 3) if dr.depth_v(old) == 2 else ("one number", 1)
    if value is not None and dr.is_tensor_v(value) and dr.prod(value.shape) == size:
        # As arrays, which gradients go through
        value = value.array if size == 1 else dr.unravel(type(old), value.array)
    if value is not None and dr.is_jit_v(value):
        alike = dr.depth_v(value) == dr.depth_v(old) and dr.size_v(value) == dr.size_v(old)
        if not alike or dr.width(value) != 1:
            raise ValueError(
                f"{name}: expected {want}, got {type(value).__name__} of shape {dr.shape(value)}"
            )
        return value if type(value) is type(old) else type(old)(value)
    numbers = _numbers_in(value)
    if len(numbers) != size or not np.isfinite(numbers).all():
        raise ValueError(f"{name}: expected {want}, got {value!r}")
    return type(old)(*numbers)


def _as_many(name: str, value: Any, old: Array) -> Array:
    """The same for a parameter that has a number, or a vector, for each sphere of a cloud."""
    count, vectors = dr.width(old), dr.depth_v(old) == 2
    shape = (count, 3) if vectors else (count,)
    if value is not None and dr.is_tensor_v(value) and value.shape == shape:
        value = dr.unravel(type(old), value.array) if vectors else value.array
    if value is not None and dr.is_jit_v(value) and not dr.is_tensor_v(value):
        alike = dr.depth_v(value) == dr.depth_v(old) and dr.size_v(value) == dr.size_v(old)
        if alike and dr.width(value) == count:
            return value if type(value) is type(old) else type(old)(value)
        got = f"{type(value).__name__} of shape {dr.shape(value)}"
    else:
        try:
            numbers = np.asarray(value)
        except ValueError:
            numbers = np.empty(0)
        if numbers.shape == shape and numbers.dtype.kind in "fiu":
            dtype = precision_of(old).dtype
            return from_numbers(np.ascontiguousarray(numbers.T, dtype), precision_of(old))
        real = numbers.size and numbers.dtype.kind in "fiu"
        got = f"an array of shape {numbers.shape}" if real else repr(value)
    remedy = f"replace '{name.rpartition('.')[0]}.spheres' for another number of spheres"
    raise ValueError(f"{name}: expected numbers of shape {shape}, got {got}; {remedy}")


def _numbers_in(value: object) -> list[float]:
    """The numbers that a value consists of; none if it has something else, as a file may not."""
    try:
        parts = np.asarray(plain(value), dtype=object).ravel().tolist()
        legal = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in parts)
        return [float(x) for x in parts] if legal else []
    except (OverflowError, TypeError, ValueError):
        return []


def numbers_of(
    arrays: Mapping[str, Array], locations: Mapping[str, Location]
) -> dict[str, Numbers]:
    """The numbers of parameters; of clouds, arrays. Waits for the kernels that compute them."""
    known = {name: dr.detach(array) for name, array in arrays.items()}
    dr.eval(known)
    found: dict[str, Any] = {}
    for name, array in known.items():
        vector = dr.depth_v(array) == 2
        if locations[name].entry.many:
            found[name] = array.numpy().T.copy()
        else:
            found[name] = tuple(part[0] for part in array) if vector else (array[0],)
    return found


def check_numbers(
    numbers: Mapping[str, Numbers], locations: Mapping[str, Location], remedy: str
) -> None:
    """Refuse numbers that have no meaning.

    Args:
        remedy: the end of the message.

    Raises:
        ValueError: a number outside of its parameter's range, by more than `OVERSTEP` where the
            range is closed.
    """
    for name, own in numbers.items():
        entry = locations[name].entry
        if entry.many:
            _check_many(name, own, entry, remedy)
            continue
        told = f"{name} = {', '.join(f'{x:g}' for x in own)}"
        if not all(entry.legal.holds(x, OVERSTEP) for x in own):
            expected = entry.legal.expected(entry.size, own)
            raise ValueError(f"{told}: expected {expected}{remedy}")
        if entry.legal.direction and not any(own):
            raise ValueError(f"{told}: expected a direction, not zero")


def _check_many(name: str, numbers: Any, entry: Parameter, remedy: str) -> None:
    """The same for the numbers of a cloud."""
    least = 1 / LARGEST if entry.legal.open else -LARGEST
    rows = numbers.reshape(-1, entry.size)
    bad = np.flatnonzero(~((rows >= least) & (rows <= LARGEST)).all(1))
    if bad.size:
        told = ", ".join(f"{x:g}" for x in rows[bad[0]])
        expected = entry.legal.expected(entry.size, rows[bad[0]].tolist())
        raise ValueError(f"{name}, sphere {bad[0]} = {told}: expected {expected}{remedy}")
