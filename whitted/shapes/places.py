"""What the numbers of shapes tell of their primitives, before a ray is traced."""

from collections.abc import Hashable, Iterable, Sequence

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
        if places.setdefault((shape.group, shape.place(*own)), k) != k:
            hidden.add(k)
        if eye is not None and shape.needs_compensation(eye, *own):
            compensated.add(k)
    return frozenset(hidden), frozenset(compensated)
