"""A scene as a short table."""

from typing import Any

from ..core.parameter import parameters_of

# Things in the table, at most, and letters of a name
THINGS, LETTERS = 12, 20


def summary(scene: Any) -> str:
    """A line for the scene, and one for each of its first things."""
    width, height = scene.resolution
    depth, precision = scene.max_depth, scene.precision.name
    title = f"Scene, {width} x {height} pixels, depth {depth}, {precision} precision"
    # A scene in a kernel has no numbers
    if "numbers" not in scene.__dict__:
        return title
    things = [(thing.group, thing) for thing in (*scene.shapes, *scene.clouds)]
    things += [("lights", thing) for thing in scene.lights]
    rows = [("camera", "", "", _numbers(scene, "camera", scene.camera))]
    rows += [
        (
            group[:-1],
            thing.name,
            getattr(thing, "material", ""),
            _numbers(scene, f"{group}.{thing.name}", thing),
        )
        for group, thing in things[:THINGS]
    ]
    cells = [[_short(cell) for cell in row[:3]] + [row[3]] for row in rows]
    widths = [max(len(row[k]) for row in cells) for k in range(3)]
    lines = ["  ".join([*map(str.ljust, row, widths), row[3]]) for row in cells]
    more = len(things) - THINGS
    return "\n".join([title, *lines, *([f"and {more} more"] if more > 0 else [])])


def _numbers(scene: Any, prefix: str, thing: Any) -> str:
    if prefix.startswith("clouds."):
        return f"{len(scene.numbers[f'{prefix}.radius'])} spheres"
    told = []
    for field in parameters_of(type(thing)):
        told.append(f"{field} {' '.join(f'{x:.4g}' for x in scene.numbers[f'{prefix}.{field}'])}")
    return "  ".join(told)


def _short(text: str) -> str:
    return text if len(text) <= LETTERS else text[: LETTERS - 3] + "..."
