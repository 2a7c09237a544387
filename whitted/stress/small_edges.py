"""Hard case 28: edges of small objects, and edges that cross or crowd within a pixel."""

import math
from collections.abc import Iterator

import numpy as np

from ..core.arrays import DOUBLE, SINGLE, Precision
from ..scene.scene import Scene
from .arrays import worst
from .case import Case, Chart, Check, Curve
from .scenes import (
    WHITE,
    WHITE_AMBIENT,
    ball,
    camera,
    disc,
    finite_checks,
    forward,
    material,
    scene_of,
    slope_checks,
    total,
    wall,
)

SIDE, FOV, DISTANCE = 32, 40.0, 4.0
VIEW = camera((0, 0, DISTANCE), (0, 0, 0), FOV, (SIDE, SIDE))
RADIUS = "spheres.ball.radius"
SKY = "background = [0.2, 0.4, 0.9]\n"
RED = material("red", color=[0.7, 0.1, 0.2])


def small(p: Precision) -> Iterator[Check]:
    for pixels in (0.05, 0.2, 0.5, 1.5):
        yield from _speck_checks(p, pixels)
    yield from _crossing_checks(p)


def _speck_checks(p: Precision, pixels: float) -> Iterator[Check]:
    """A sphere with a radius of so many pixels, beside a pixel's centre."""
    radius = pixels * 2 * DISTANCE * math.tan(math.radians(FOV) / 2) / SIDE
    sphere = ball("ball", (0.02, 0.03, 0), radius, "white")
    scene = scene_of(p, WHITE_AMBIENT, VIEW, WHITE, sphere)
    by_radius = disc(DISTANCE, radius, SIDE, FOV).by_radius
    errors = []
    for spp in (1, 16, 256):
        found = total(forward(scene, RADIUS, None, spp, boundary=True))
        what = f"radius of {pixels} pixel, spp {spp}: d sum / d radius, over the right one"
        yield Check(what, abs(found) / by_radius, 2)
        errors.append(abs(found / by_radius - 1))
    # Distance of samples over the radius, at spp 256. From 1/2 on the sphere may be missed; below,
    # the error is that of a polygon in place of a circle.
    spacing = 1 / 16 / pixels
    bound = 1 if spacing > 0.5 else 0.1 * spacing
    yield Check(f"radius of {pixels} pixel, spp 256: relative error", errors[-1], bound)
    growth = errors[-1] / max(errors[0], 0.02)
    yield Check(f"radius of {pixels} pixel: error at spp 256, over that at spp 1", growth, 1)


def _crossing_checks(p: Precision) -> Iterator[Check]:
    """Two walls seen at grazing angles, and two spheres whose silhouettes cross."""
    walls = wall("floor", (0, 1, 0), 0.001, "red") + wall("side", (1, 0, 0), 0.001, "white")
    pair = ball("near", (0.3, 0.3, 0), 0.4, "red") + ball("far", (-0.3, -0.3, 1), 0.4, "white")
    parts = SKY, WHITE_AMBIENT, VIEW, RED, WHITE
    # The walls meet along a diagonal through samples. u pixels from the middle, a unit of offset
    # moves the line where they meet by u / 0.001 pixels; u is at most 16. For the pair, a unit is
    # 11 pixels, and a pixel holds at most two edges of length sqrt(2).
    for what, objects, name, bound in (
        ("grazing edges", walls, "planes.floor.offset", 16 / 0.001),
        ("crossing edges", pair, "spheres.near.radius", 100),
    ):
        scene = scene_of(p, *parts, objects)
        yield from finite_checks(scene, what, name, boundary=True)
        largest = worst(forward(scene, name, boundary=True))
        yield Check(f"{what}: largest d pixel / d {name}", largest, bound)
    # The sum of u / 0.001 along the diagonal, times the jump from red to white
    expected = 16**2 / 2 / 0.001 * (1 - (0.7 + 0.1 + 0.2) / 3)
    scene = scene_of(p, *parts, walls)
    yield from slope_checks(scene, "planes.floor.offset", None, expected, 5e-3, boundary=True)


def _rings(p: Precision, edges: int, most: int) -> tuple[Scene, float, float]:
    """Concentric silhouettes within the width of one pixel, white and black by turns.

    Args:
        edges: the number of silhouettes.
        most: the number of spheres; those left over are behind the camera, so that one kernel
            serves all numbers of edges.

    Returns:
        The scene, the derivative of the image's total by the field of view in degrees, and the sum
        of the absolute values of its terms.
    """
    side = 16
    f = side / 2 / math.tan(math.radians(FOV) / 2)
    parts: list[str] = []
    values: dict[str, object] = {}
    for k in range(most):
        distance, pixels = 10 + 3 * k, 5 + (k + 0.5) / edges
        color = "white" if (edges - k) % 2 else "black"
        parts.append(ball(f"b{k}", (0, 0, -distance), 1, color))
        values[f"spheres.b{k}.center"] = [0, 0, -distance if k < edges else distance + 100]
        values[f"spheres.b{k}.radius"] = distance * math.sin(math.atan(pixels / f))
    view = camera((0, 0, 0), (0, 0, -1), FOV, (side, side))
    scene = scene_of(p, WHITE_AMBIENT, view, WHITE, material("black"), *parts)
    areas = math.pi * (5 + (np.arange(edges) + 0.5) / edges) ** 2
    by_fov = -2 * math.radians(1) / math.sin(math.radians(FOV)) * areas
    signs = np.where((edges - np.arange(edges)) % 2, 1.0, -1.0)
    return scene.replace(values), float((signs * by_fov).sum()), float(abs(by_fov).sum())


def small_chart() -> Chart:
    counts, curves = np.arange(1, 9), []
    for p, spp in ((SINGLE, 1), (SINGLE, 4), (SINGLE, 16), (DOUBLE, 64)):
        errors = []
        for n in counts.tolist():
            scene, by_fov, size = _rings(p, n, counts.size)
            found = total(forward(scene, "camera.fov", None, spp, boundary=True))
            errors.append(abs(found - by_fov) / size)
        curves.append(Curve(f"AD with edges, spp {spp}, {p.name}", counts, np.array(errors)))
    return Chart(
        "Edges within one pixel",
        "number of edges",
        "error of d sum / d fov, relative to its absolute terms (1 is 100 %)",
        tuple(curves),
        0.1,
        linear=True,
    )


CASES = (
    Case(
        28,
        "small and crossing edges",
        "bounded derivatives, whose error falls as spp grows",
        "What no sample hits has no derivative: an error of 1. From two samples per radius on, "
        "chords lose less than 1/10 of the spacing over the radius. A derivative is at most the "
        "length of an edge in a pixel times the edge's speed.",
        small,
        small_chart,
    ),
)
