"""What the numbers of shapes tell of their primitives, before a ray is traced."""

from collections.abc import Hashable, Iterable, Sequence
from functools import lru_cache

from ..core.parameter import Numbers
from .shape import Shape


def told_by_places(
    shapes: Sequence[Shape], numbers: Iterable[Sequence[Numbers]], eye: Numbers | None
) -> tuple[frozenset[int], frozenset[int]]:
    """Which primitives are hidden, and which need compensated sums, by their numbers in the scene.

    Args:
        numbers: those of each shape, in the order of its parameters.
        eye: the position of the camera; None in double precision, which needs no compensated sums.

    Returns:
        The primitives that coincide with an earlier one, and so are never met; and those that
        single precision would meet at the wrong places.
    """
    places: dict[Hashable, int] = {}
    hidden, compensated = set(), set()
    for k, (shape, own) in enumerate(zip(shapes, numbers, strict=True)):
        place, careful = _told(type(shape), eye, *own)
        if places.setdefault(place, k) != k:
            hidden.add(k)
        if careful:
            compensated.add(k)
    return frozenset(hidden), frozenset(compensated)


# From one step of an optimiser to the next, most shapes stay where they are
@lru_cache(maxsize=1 << 12)
def _told(kind: type[Shape], eye: Numbers | None, *numbers: Numbers) -> tuple[Hashable, bool]:
    """A shape's place among all kinds, and whether it needs compensated sums."""
    careful = eye is not None and kind.needs_compensation(eye, *numbers)
    return (kind, kind.place(*numbers)), careful
