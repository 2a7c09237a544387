"""What the numbers of shapes, lights and the eye tell, before a ray is traced."""

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from ..core.arrays import Precision
from ..core.parameter import Numbers
from .shape import Shape


@dataclass(frozen=True)
class PlacesOfMany:
    """The same of the spheres in a tree, of which each has a bit for the eye and for each light."""

    compensated: bool  # some need sums that keep their rounding errors
    under_eye: bool  # the eye is exactly on some
    under_lights: tuple[int, ...]  # the lights that are exactly on some


@dataclass(frozen=True)
class Places:
    """Facts about where primitives are; they are named by their numbers in the scene."""

    # Those that coincide with an earlier one, and so are never met
    hidden: frozenset[int]
    # Those that need sums that keep their rounding errors
    compensated: frozenset[int]
    # Those that the eye is exactly on
    under_eye: frozenset[int]
    # For each light, those that it is exactly on
    under_lights: tuple[frozenset[int], ...]
    # None without a tree of spheres
    many: PlacesOfMany | None = None


def places_of(
    shapes: Sequence[Shape],
    numbers: Iterable[Sequence[Numbers]],
    eye: Numbers,
    lights: Sequence[Numbers | None],
    precision: Precision,
) -> Places:
    """The facts about some shapes.

    Args:
        numbers: those of each shape, in the order of its parameters.
        eye: the position of the camera.
        lights: the position of each light; None for one at infinity.
        precision: that of the numbers.
    """
    seen: dict[Hashable, int] = {}
    hidden: set[int] = set()
    compensated: set[int] = set()
    under_eye: set[int] = set()
    under_lights: list[set[int]] = [set() for _ in lights]
    for k, (shape, own) in enumerate(zip(shapes, numbers, strict=True)):
        kind = type(shape)
        if seen.setdefault(_place(kind, *own), k) != k:
            hidden.add(k)
        if _careful(kind, eye, precision, *own):
            compensated.add(k)
        for point, under in ((eye, under_eye), *zip(lights, under_lights, strict=True)):
            if point is not None and _passes_through(kind, point, precision, *own):
                under.add(k)
    return Places(
        frozenset(hidden),
        frozenset(compensated),
        frozenset(under_eye),
        tuple(map(frozenset, under_lights)),
    )


# From one step of an optimiser to the next, most shapes stay where they are
_REMEMBERED = 1 << 12


@lru_cache(maxsize=_REMEMBERED)
def _place(kind: type[Shape], *numbers: Numbers) -> Hashable:
    return kind, kind.place(*numbers)


@lru_cache(maxsize=_REMEMBERED)
def _careful(kind: type[Shape], eye: Numbers, precision: Precision, *numbers: Numbers) -> bool:
    return kind.needs_compensation(eye, precision, *numbers)


@lru_cache(maxsize=_REMEMBERED)
def _passes_through(
    kind: type[Shape], point: Numbers, precision: Precision, *numbers: Numbers
) -> bool:
    return kind.passes_through(point, precision, *numbers)
