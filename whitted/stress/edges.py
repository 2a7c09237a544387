"""Hard cases of moving edges: 24 to 26, against closed forms, with plain AD and differences."""

import math
from collections.abc import Iterator

import numpy as np

from ..core.arrays import PRECISIONS, Precision
from ..scene.scene import Scene
from .arrays import rounded
from .case import Case, Chart, Check, Curve
from .scenes import (
    GLASS,
    WHITE,
    WHITE_SKY,
    ball,
    camera,
    finite_checks,
    forward,
    lamp,
    picture,
    scene_of,
    slope_checks,
    total,
    wall,
    white_ball,
)

RADIUS = "spheres.ball.radius"
# Of a sum over the image: 0.1 % in double precision; in single, roundings of a large sum add up
TOLERANCE = {"single": 5e-3, "double": 1e-3}
# Methods of a chart: label of AD, and whether with edges
METHODS = (("plain AD", False), ("AD with edges", True))

# 24: the shadow of a sphere

LIGHT_HEIGHT, BALL_HEIGHT, BALL_RADIUS = 4.0, 2.0, 0.4


def _shadow_scene(p: Precision, side: int) -> tuple[Scene, float, float]:
    """A sphere between a light and a floor; the camera, below the sphere, sees the whole shadow.

    Returns:
        The scene, and the derivatives of the image's total by the sphere's radius and height.
    """
    view = camera((0, 1, 0), (0, 0, 0), 90, (side, side), (0, 0, -1))
    sphere = ball("ball", (0, BALL_HEIGHT, 0), BALL_RADIUS, "white")
    floor = wall("floor", (0, 1, 0), 0, "white")
    scene = scene_of(p, view, WHITE, sphere, floor, lamp((0, LIGHT_HEIGHT, 0)))
    # The shadow is a disc, whose radius follows from the sine of the cone's half angle
    gap = LIGHT_HEIGHT - BALL_HEIGHT
    sine = BALL_RADIUS / gap
    radius = LIGHT_HEIGHT * math.tan(math.asin(sine))
    radius_by_sine = LIGHT_HEIGHT / (1 - sine**2) ** 1.5
    # Light along the disc's edge, which the floor reflects by the cosine
    cosine = LIGHT_HEIGHT / math.hypot(LIGHT_HEIGHT, radius)
    total_by_sine = -2 * math.pi * (side / 2) ** 2 * radius * cosine * radius_by_sine
    return scene, total_by_sine / gap, total_by_sine * BALL_RADIUS / gap**2


def shadow(p: Precision) -> Iterator[Check]:
    scene, by_radius, by_height = _shadow_scene(p, 256)
    bound = TOLERANCE[p.name]
    yield from slope_checks(scene, RADIUS, None, by_radius, bound, 16, boundary=True)
    yield from slope_checks(scene, "spheres.ball.center", "y", by_height, bound, 16, boundary=True)


def _difference(scene: Scene, step: float, **options: object) -> float:
    """A central difference of the image's total by the radius."""
    value = float(scene.parameters(RADIUS)[RADIUS].numpy()[0])
    upper, lower = (
        total(picture(scene.replace({RADIUS: value + sign * step}), 4, **options))
        for sign in (1, -1)
    )
    return (upper - lower) / (2 * step)


def shadow_chart() -> Chart:
    steps, curves = np.logspace(-9, -1, 25), []
    for p in PRECISIONS:
        scene, by_radius, _ = _shadow_scene(p, 64)
        for label, edges in (("of plain samples", False), ("with edges", True)):
            found = np.array([_difference(scene, step, boundary=edges) for step in steps.tolist()])
            error = abs(found / by_radius - 1)
            curves.append(Curve(f"differences {label}, {p.name}", steps, error))
        for label, edges in METHODS:
            slope = total(forward(scene, RADIUS, None, 4, boundary=edges))
            error = np.full(steps.size, abs(slope / by_radius - 1))
            curves.append(Curve(f"{label}, {p.name}", steps, error))
    return Chart(
        "Derivative of a shadow's area by the radius of the sphere",
        "step of the differences (scene units)",
        "relative error (1 is 100 %)",
        tuple(curves),
        1e-2,
    )


# 25: a silhouette


def silhouette(p: Precision) -> Iterator[Check]:
    scene, expected = white_ball(p, 4.0, 0.9, 256, 40.0)
    bound = TOLERANCE[p.name]
    area = total(picture(scene, 16, boundary=True))
    yield Check("area, relative", abs(area / expected.area - 1), bound)
    yield from slope_checks(scene, RADIUS, None, expected.by_radius, bound, 16, boundary=True)
    by_distance = expected.by_distance
    yield from slope_checks(scene, "camera.position", "z", by_distance, bound, 16, boundary=True)


def silhouette_chart() -> Chart:
    sides, curves = np.array([4, 8, 16, 32, 64, 128]), []
    for p in PRECISIONS:
        errors = []
        for side in sides.tolist():
            scene, expected = white_ball(p, 4.0, 0.9, side, 40.0)
            row = []
            for edges in (False, True):
                row.append(total(picture(scene, boundary=edges)) / expected.area - 1)
                row.append(total(forward(scene, RADIUS, boundary=edges)) / expected.by_radius - 1)
            errors.append(row)
        labels = "area by plain samples", "plain AD", "area with edges", "AD with edges"
        for label, error in zip(labels, np.array(errors).T, strict=True):
            curves.append(Curve(f"{label}, {p.name}", sides, abs(error)))
    return Chart(
        "Area of a sphere's silhouette, and its derivative by the radius",
        "resolution (pixels along a side)",
        "relative error (1 is 100 %)",
        tuple(curves),
        1e-2,
    )


# 26: a jump of radiance that vanishes

REFLECTIONS = (0.0, 0.5, 0.9, 0.99, 0.999, 1.0)


def _fading(p: Precision, reflection: float) -> tuple[Scene, float]:
    """A mirror ball in a white sky, darker than the sky by 1 - reflection.

    Returns:
        The scene, and d area / d radius of the silhouette.
    """
    scene, expected = white_ball(p, 4.0, 0.9, 32, 40.0)
    values = {
        "ambient": [0, 0, 0],
        "background": [1, 1, 1],
        "materials.white.reflection": reflection,
    }
    return scene.replace(values), expected.by_radius


def fading(p: Precision) -> Iterator[Check]:
    for reflection in REFLECTIONS:
        scene, by_radius = _fading(p, reflection)
        jump = 1 - reflection
        expected = -jump * by_radius
        # At spp 4 an edge with a jump below 1/32 may be left to the samples (`LEAST_WEIGHT` of the
        # boundary term, over spp), which miss at most all of it
        bound = (2e-3 if jump > 1 / 32 else 1.001 * jump + 8 * p.epsilon) * by_radius
        bound /= abs(expected) or 1
        yield from slope_checks(scene, RADIUS, None, expected, bound, 4, boundary=True)
    view = camera((0, 0, 4), (0, 0, 0), 40, (32, 32))
    rim = scene_of(p, WHITE_SKY, view, GLASS, ball("ball", (0, 0, 0), 0.9, "glass"))
    yield from finite_checks(rim, "Fresnel rim", RADIUS, boundary=True)
    yield from finite_checks(rim, "Fresnel rim, by index", "materials.glass.ior", boundary=True)


def fading_chart() -> Chart:
    jumps, curves = np.logspace(-5, 0, 21), []
    for p in PRECISIONS:
        for label, edges in METHODS:
            errors = []
            for jump in rounded(p, jumps).tolist():
                scene, by_radius = _fading(p, 1 - jump)
                slope = total(forward(scene, RADIUS, None, 4, boundary=edges))
                errors.append(abs(slope / by_radius + jump))
            curves.append(Curve(f"{label}, {p.name}", jumps, np.array(errors)))
    return Chart(
        "Derivative of a ball that fades into its background, by its radius",
        "jump of radiance at the edge (where white is 1)",
        "error, relative to d area / d radius (1 is 100 %)",
        tuple(curves),
        1e-2,
    )


CASES = (
    Case(
        24,
        "shadow of a sphere",
        "a disc of radius H tan(asin(r / (H - h))); the derivatives of its light in closed form",
        "Edges are chords between samples 1/4 pixel apart: an error of second order in 1/400 of "
        "the disc's radius. In single precision, a crossing is off by at most the root of a "
        "rounding, and a sum of 1e6 samples by about 1e-3.",
        shadow,
        shadow_chart,
    ),
    Case(
        25,
        "silhouette of a sphere",
        "pi f^2 r^2 / (d^2 - r^2) pixels; d area / d r = 2 pi f^2 r d^2 / (d^2 - r^2)^2",
        "As for the shadow.",
        silhouette,
        silhouette_chart,
    ),
    Case(
        26,
        "vanishing jump",
        "an edge counts by its jump of radiance, 1 - reflection, down to 0; a Fresnel rim is "
        "finite",
        "Edges are chords at 32 x 32 pixels, spp 4: an error below 2e-3. At that spp, an edge with "
        "a jump below 1/32 may be left out, which is an error of its jump.",
        fading,
        fading_chart,
    ),
)
