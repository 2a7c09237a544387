"""The parameters of a scene as a page shows them: grouped as in a file, with ranges of sliders."""

import math
from typing import Any

from ..core.parameter import OVERSTEP, Parameter
from ..inverse.bounds import scales_of
from ..scene.scene import Scene

# A slider of an open range goes so many large changes to each side
REACH = 4.0
# Of a number that is not negative, up to this multiple of it
MULTIPLE = 4.0


def groups_of(scene: Scene) -> list[dict[str, Any]]:
    """A scene's things in the order of a file, each with its parameters.

    Returns:
        Dictionaries for JSON: "name" of the thing, and "parameters", each with its whole "name",
        its "field", its "value" (one number or three), and the "low", "high" and "step" of its
        slider. Those of clouds are left out.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for name, where in scene.locations.items():
        if not where.entry.many:
            thing, field = _parted(name)
            found.setdefault(thing, []).append({"field": field, **_slider(scene, name)})
    things = sorted(found, key=_order)
    return [{"name": thing, "parameters": found[thing]} for thing in things]


def sizes_of(scene: Scene) -> dict[str, int]:
    """How many numbers each parameter has that a page shows."""
    return {
        name: len(value)
        for name, value in scene.numbers.items()
        if not scene.locations[name].entry.many
    }


def _parted(name: str) -> tuple[str, str]:
    """The thing and the field of a parameter. "materials.white.checker.color" is the material's."""
    parts = name.split(".")
    if len(parts) == 1:
        return "scene", name
    count = 1 if parts[0] == "camera" else 2
    return ".".join(parts[:count]), ".".join(parts[count:])


def _order(thing: str) -> int:
    """Where a thing stands in a file: sorting keeps the order of those of one kind."""
    kinds = ("scene", "camera", "spheres", "discs", "planes", "materials", "lights")
    kind = thing.partition(".")[0]
    return kinds.index(kind) if kind in kinds else len(kinds)


def _slider(scene: Scene, name: str) -> dict[str, Any]:
    """The name, the numbers and the range of one parameter."""
    value, entry = scene.numbers[name], scene.locations[name].entry
    low, high = _range(entry, value, float(scales_of(scene, [name])[0]))
    step = 10.0 ** math.floor(math.log10((high - low) / 500))
    return {"name": name, "value": list(value), "low": low, "high": high, "step": step}


def _range(entry: Parameter, value: tuple[float, ...], scale: float) -> tuple[float, float]:
    """The ends of a slider: those of what is usual, or some large changes away from the numbers."""
    if entry.legal.direction:
        longest = max(1.0, *map(abs, value))
        return -longest, longest
    usual = entry.usual if all(entry.usual.holds(x, OVERSTEP) for x in value) else entry.legal
    low, high = usual.low, usual.high
    if math.isfinite(low) and not math.isfinite(high):
        high = low + max(MULTIPLE * (max(value) - low), scale, 1e-3)
    low = low if math.isfinite(low) else min(value) - REACH * scale
    high = high if math.isfinite(high) else max(value) + REACH * scale
    # An open end is not reached
    return (low + (high - low) * 1e-3, high - (high - low) * 1e-3) if usual.open else (low, high)
