"""What values parameters can take, and what change of one is large: an optimiser's bounds and steps without tuning."""

from collections.abc import Mapping

import numpy as np

from .scene import Scene

Bounds = Mapping[str, tuple[float | None, float | None]]

# The legal range of each kind of parameter, where it has one; an index below 1 is legal, but rarely meant
RANGES = {
    "radius": (0.0, np.inf),
    "color": (0.0, 1.0),
    "specular": (0.0, np.inf),
    "shininess": (0.0, np.inf),
    "reflection": (0.0, 1.0),
    "refraction": (0.0, 1.0),
    "ior": (1.0, np.inf),
    "intensity": (0.0, np.inf),
    "fov": (0.0, 180.0),
    "background": (0.0, np.inf),
    "ambient": (0.0, np.inf),
}
# Those that must stay above 0, and by what part of their start they do
POSITIVE, LEAST = ("radius", "shininess", "fov"), 1e-3
# A large change of the rest, which have no length or size of their own
LARGE = 0.2


def limits(scene: Scene, names: list[str], bounds: Bounds) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and highest values of parameters, as vectors.

    Args:
        bounds: name to (lowest, highest), either None where it is open, in place of the legal range.

    Raises:
        KeyError: bounds of a parameter that is not fitted.
        ValueError: bounds that are not a pair, are the wrong way round, outside what is legal, or exclude the start.
    """
    for name in bounds:
        if name not in names:
            raise KeyError(f"bounds: '{name}' is not among the parameters to fit; those are {', '.join(names)}")
    low, high = [], []
    for name in names:
        start = start_of(scene, name)
        least, most = _range(name, start)
        if name in bounds:
            least, most = _asked(name, bounds[name], least, most)
        outside = (start < least) | (start > most)
        if outside.any():
            at = ", ".join(f"{value:g}" for value in start)
            raise ValueError(f"bounds: {name} starts at {at}, outside [{least:g}, {most:g}]; move the start or the bounds")
        low.append(np.full(start.size, least))
        high.append(np.full(start.size, most))
    return np.concatenate(low), np.concatenate(high)


def start_of(scene: Scene, name: str) -> np.ndarray:
    """The numbers of a parameter."""
    return np.asarray(scene.parameters(name)[name].numpy(), np.float64).ravel()


def _range(name: str, start: np.ndarray) -> tuple[float, float]:
    field = name.rpartition(".")[2]
    least, most = RANGES.get(field, (-np.inf, np.inf))
    if field in POSITIVE:
        least = LEAST * float(start[0])
    # A start below 1 says that such an index is meant
    if field == "ior" and start[0] < 1:
        least = LEAST * float(start[0])
    return least, most - LEAST if field == "fov" else most


def _asked(name: str, pair: tuple[float | None, float | None], least: float, most: float) -> tuple[float, float]:
    """The bounds that the user asks for, checked against what is legal."""
    try:
        low, high = (default if value is None else float(value) for value, default in zip(pair, (least, most), strict=True))
    except (TypeError, ValueError):
        raise ValueError(f"bounds: {name}: expected (lowest, highest), got {pair!r}") from None
    if not low <= high:
        raise ValueError(f"bounds: {name}: the lowest, {low:g}, is not below the highest, {high:g}")
    legal = RANGES.get(name.rpartition(".")[2], (-np.inf, np.inf))
    floor = 0.0 if name.endswith(".ior") else legal[0]
    if low < floor or high > legal[1]:
        raise ValueError(f"bounds: {name}: [{low:g}, {high:g}] is not within what is legal, [{floor:g}, {legal[1]:g}]")
    return low, high


def scales(scene: Scene, names: list[str]) -> np.ndarray:
    """A large change of each number: sizes for positions of spheres, a part of the distance to what is seen for others."""
    return np.concatenate([np.full(start_of(scene, name).size, _scale(scene, name)) for name in names])


def _scale(scene: Scene, name: str) -> float:
    kind, _, rest = name.partition(".")
    field = name.rpartition(".")[2]
    size = float(np.abs(start_of(scene, name)).max())
    distance = float(np.linalg.norm(start_of(scene, "camera.position") - start_of(scene, "camera.look_at")))
    if kind == "spheres":
        return float(start_of(scene, f"spheres.{rest.rpartition('.')[0]}.radius")[0])
    if field in ("position", "look_at", "offset"):
        return distance / 4 if kind == "lights" else distance / 10
    if field in ("shininess", "fov", "intensity"):
        return size / 2 or 1.0
    return LARGE
