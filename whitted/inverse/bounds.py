"""Bounds and scales of a fit's numbers: which values they can take, and what change is large."""

from collections.abc import Mapping

import numpy as np

from ..core.parameter import Parameter, Range
from ..scene.scene import Scene

Bounds = Mapping[str, tuple[float | None, float | None]]

# A number that must stay above 0 does so by this part of its start
LEAST = 1e-3


def bounds_of(scene: Scene, names: list[str], asked: Bounds) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and highest values of parameters, as vectors.

    Args:
        asked: name to (lowest, highest), in place of the usual range; None keeps the usual end.

    Raises:
        KeyError: bounds of a parameter that is not fitted.
        ValueError: bounds that are not a pair, are the wrong way round, are outside what is legal,
            or exclude the start.
    """
    if not isinstance(asked, Mapping):
        raise ValueError(
            f"bounds: expected a dictionary of names and (lowest, highest), got {asked!r}"
        )
    for name in asked:
        if name not in names:
            fitted = ", ".join(names)
            raise KeyError(
                f"bounds: '{name}' is not among the parameters to fit; those are {fitted}"
            )
    low, high = [], []
    for name in names:
        start, entry = start_of(scene, name), scene.locations[name].entry
        least, most = _usual(entry, start)
        if name in asked:
            least, most = _checked(name, asked[name], entry.legal, (least, most))
        if ((start < least) | (start > most)).any():
            at = ", ".join(f"{value:g}" for value in start)
            raise ValueError(
                f"bounds: {name} starts at {at}, outside [{least:g}, {most:g}]; "
                "move the start or the bounds"
            )
        low.append(np.full(start.size, least))
        high.append(np.full(start.size, most))
    return np.concatenate(low), np.concatenate(high)


def start_of(scene: Scene, name: str) -> np.ndarray:
    """The numbers of a parameter; of a cloud, sphere by sphere."""
    return np.asarray(scene.parameters(name)[name].numpy(), np.float64).T.ravel()


def shapes_of(scene: Scene, names: list[str]) -> tuple[tuple[int, ...], ...]:
    """The shapes of parameters: () of a number, (3,) of a vector, (N,) or (N, 3) of a cloud."""
    found = []
    for name in names:
        entry = scene.locations[name].entry
        vector = (3,) if entry.size == 3 else ()
        spheres = (start_of(scene, name).size // entry.size,) if entry.many else ()
        found.append((*spheres, *vector))
    return tuple(found)


def _usual(entry: Parameter, start: np.ndarray) -> tuple[float, float]:
    """Where a parameter is looked for.

    A start outside of the usual range, such as an index below 1, tells that all legal values are
    meant.
    """
    usual = entry.usual if all(entry.usual.holds(x) for x in start) else entry.legal
    least, most = usual.low, usual.high
    if usual.open:
        # Stay away from ends that do not belong to the range
        least, most = LEAST * float(start.min()), most - LEAST
    return least, most


def _checked(
    name: str, pair: tuple[float | None, float | None], legal: Range, usual: tuple[float, float]
) -> tuple[float, float]:
    """The bounds that the user asks for, checked against what is legal."""
    try:
        low, high = pair
        low = usual[0] if low is None else float(low)
        high = usual[1] if high is None else float(high)
    except (TypeError, ValueError):
        raise ValueError(f"bounds: {name}: expected (lowest, highest), got {pair!r}") from None
    if not low <= high:
        raise ValueError(f"bounds: {name}: the lowest, {low:g}, is not below the highest, {high:g}")
    if low < legal.low or high > legal.high:
        within = f"[{legal.low:g}, {legal.high:g}]"
        asked = f"[{low:g}, {high:g}]"
        raise ValueError(f"bounds: {name}: {asked} is not within what is legal, {within}")
    return low, high


def scales_of(scene: Scene, names: list[str]) -> np.ndarray:
    """A large change of each number, as the field of its parameter says (`core/parameter.py`)."""
    sizes = (start_of(scene, name).size for name in names)
    scales = [np.full(size, _scale(scene, name)) for name, size in zip(names, sizes, strict=True)]
    return np.concatenate(scales)


def _scale(scene: Scene, name: str) -> float:
    scale = scene.locations[name].entry.scale
    if scale.of == "radius":
        return scale.part * float(np.median(start_of(scene, f"{name.rpartition('.')[0]}.radius")))
    if scale.of == "view":
        eye, target = start_of(scene, "camera.position"), start_of(scene, "camera.look_at")
        return scale.part * float(np.linalg.norm(eye - target))
    if scale.of == "value":
        return scale.part * float(np.abs(start_of(scene, name)).max()) or 1.0
    return scale.part
