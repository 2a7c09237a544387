"""What values a fit's numbers can take, and what change of one is large: bounds and steps without
tuning.
"""

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
        asked: name to (lowest, highest), either None where it is open, in place of the usual range.

    Raises:
        KeyError: bounds of a parameter that is not fitted.
        ValueError: bounds that are not a pair, are the wrong way round, outside what is legal, or
            exclude the start.
    """
    for name in asked:
        if name not in names:
            raise KeyError(
                f"bounds: '{name}' is not among the parameters to fit; those are {', '.join(names)}"
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
                f"bounds: {name} starts at {at}, outside [{least:g}, {most:g}]; move the start or the bounds"
            )
        low.append(np.full(start.size, least))
        high.append(np.full(start.size, most))
    return np.concatenate(low), np.concatenate(high)


def start_of(scene: Scene, name: str) -> np.ndarray:
    """The numbers of a parameter."""
    return np.asarray(scene.parameters(name)[name].numpy(), np.float64).ravel()


def _usual(entry: Parameter, start: np.ndarray) -> tuple[float, float]:
    """Where a parameter is looked for. A start outside of that, such as an index below 1, says that
    it is meant.
    """
    usual = entry.usual if all(entry.usual.holds(x) for x in start) else entry.legal
    least, most = usual.low, usual.high
    if usual.open:
        # Ends that do not belong to the range are kept away from
        least, most = LEAST * float(start[0]), most - LEAST
    return least, most


def _checked(
    name: str, pair: tuple[float | None, float | None], legal: Range, usual: tuple[float, float]
) -> tuple[float, float]:
    """The bounds that the user asks for, checked against what is legal."""
    try:
        low, high = (
            own if value is None else float(value) for value, own in zip(pair, usual, strict=True)
        )
    except (TypeError, ValueError):
        raise ValueError(f"bounds: {name}: expected (lowest, highest), got {pair!r}") from None
    if not low <= high:
        raise ValueError(f"bounds: {name}: the lowest, {low:g}, is not below the highest, {high:g}")
    if low < legal.low or high > legal.high:
        within = f"[{legal.low:g}, {legal.high:g}]"
        raise ValueError(
            f"bounds: {name}: [{low:g}, {high:g}] is not within what is legal, {within}"
        )
    return low, high


def scales_of(scene: Scene, names: list[str]) -> np.ndarray:
    """A large change of each number: a part of what its parameter says (`core/parameter.py`)."""
    return np.concatenate(
        [np.full(start_of(scene, name).size, _scale(scene, name)) for name in names]
    )


def _scale(scene: Scene, name: str) -> float:
    scale = scene.locations[name].entry.scale
    if scale.of == "radius":
        return scale.part * float(start_of(scene, f"{name.rpartition('.')[0]}.radius")[0])
    if scale.of == "view":
        eye, target = start_of(scene, "camera.position"), start_of(scene, "camera.look_at")
        return scale.part * float(np.linalg.norm(eye - target))
    if scale.of == "value":
        return scale.part * float(np.abs(start_of(scene, name)).max()) or 1.0
    return scale.part
