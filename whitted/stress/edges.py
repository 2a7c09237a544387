"""Hard cases of edges: 24 to 26 and 28, against closed forms, with plain derivatives and
differences beside them.
"""

import math
from collections.abc import Iterator

import numpy as np

from ..core.arrays import DOUBLE, PRECISIONS, SINGLE, Precision
from ..scene.scene import Scene
from .case import Case, Chart, Check, Curve, rounded, worst
from .scenes import (
    GLASS,
    GLOW,
    SKY,
    WHITE,
    ball,
    camera,
    finite_checks,
    forward,
    lamp,
    material,
    picture,
    scene_of,
    slope_checks,
    wall,
)

# The whole image's sum: 0.1 % in double, and in single what many roundings of large sums add
TOLERANCE = {"single": 5e-3, "double": 1e-3}


def _sum(image: np.ndarray) -> float:
    return float(image.sum() / 3)


# 24: the shadow of a sphere

HIGH, AT, RADIUS = 4.0, 2.0, 0.4


def _shadow(p: Precision, side: int) -> tuple[Scene, float, float]:
    """A sphere between a light and the plane below: the scene, and the derivatives of its sum by
    radius and height.

    The light shades the plane by the cosine, and the camera, below the sphere, sees all of the
    shadow.
    """
    view = camera((0, 1, 0), (0, 0, 0), 90, (side, side), (0, 0, -1))
    scene = scene_of(
        p,
        view,
        WHITE,
        ball("ball", (0, AT, 0), RADIUS, "white"),
        wall("floor", (0, 1, 0), 0, "white"),
        lamp((0, HIGH, 0)),
    )
    sine = RADIUS / (HIGH - AT)
    disc, slope = HIGH * math.tan(math.asin(sine)), HIGH / (1 - sine**2) ** 1.5
    edge = -2 * math.pi * (side / 2) ** 2 * disc * HIGH / math.hypot(HIGH, disc)
    return scene, edge * slope / (HIGH - AT), edge * slope * RADIUS / (HIGH - AT) ** 2


def shadow(p: Precision) -> Iterator[Check]:
    scene, by_radius, by_height = _shadow(p, 256)
    yield from slope_checks(
        scene, "spheres.ball.radius", None, by_radius, TOLERANCE[p.name], 16, boundary=True
    )
    yield from slope_checks(
        scene, "spheres.ball.center", "y", by_height, TOLERANCE[p.name], 16, boundary=True
    )


def _moved(scene: Scene, name: str, step: float, **options: object) -> float:
    """A central difference of the sum by one number."""
    value = float(scene.parameters(name)[name].numpy()[0])
    upper, lower = (
        _sum(picture(scene.replace({name: value + sign * step}), 4, **options)) for sign in (1, -1)
    )
    return (upper - lower) / (2 * step)


def shadow_chart() -> Chart:
    steps, curves, name = np.logspace(-9, -1, 25), [], "spheres.ball.radius"
    for p in PRECISIONS:
        scene, by_radius, _ = _shadow(p, 64)
        for label, edges in (
            ("differences of plain samples", False),
            ("differences with edges", True),
        ):
            found = np.array([_moved(scene, name, step, boundary=edges) for step in steps.tolist()])
            curves.append(Curve(f"{label}, {p.name}", steps, abs(found / by_radius - 1)))
        for label, edges in (("plain AD", False), ("AD with edges", True)):
            error = abs(_sum(forward(scene, name, None, 4, boundary=edges)) / by_radius - 1)
            curves.append(Curve(f"{label}, {p.name}", steps, np.full(steps.size, error)))
    return Chart(
        "The area of a shadow, differentiated",
        "step of the differences",
        "relative error",
        tuple(curves),
        1e-2,
    )


# 25: a silhouette


def _silhouette(p: Precision, side: int) -> tuple[Scene, float, float, float]:
    """A glowing sphere on the axis: the scene, the pixels it covers, their derivatives by radius
    and distance.
    """
    r, d, fov = 0.9, 4.0, 40.0
    scene = scene_of(
        p,
        GLOW,
        camera((0, 0, d), (0, 0, 0), fov, (side, side)),
        WHITE,
        ball("ball", (0, 0, 0), r, "white"),
    )
    f2 = (side / 2 / math.tan(math.radians(fov) / 2)) ** 2
    area, squared = math.pi * f2 * r**2 / (d**2 - r**2), (d**2 - r**2) ** 2
    return (
        scene,
        area,
        2 * math.pi * f2 * r * d**2 / squared,
        -2 * math.pi * f2 * r**2 * d / squared,
    )


def silhouette(p: Precision) -> Iterator[Check]:
    scene, area, by_radius, by_distance = _silhouette(p, 256)
    yield Check("area", abs(_sum(picture(scene, 16, boundary=True)) / area - 1), TOLERANCE[p.name])
    yield from slope_checks(
        scene, "spheres.ball.radius", None, by_radius, TOLERANCE[p.name], 16, boundary=True
    )
    yield from slope_checks(
        scene, "camera.position", "z", by_distance, TOLERANCE[p.name], 16, boundary=True
    )


def silhouette_chart() -> Chart:
    sides, curves = np.array([4, 8, 16, 32, 64, 128]), []
    for p in PRECISIONS:
        errors = []
        for side in sides.tolist():
            scene, area, by_radius, _ = _silhouette(p, side)
            areas = (_sum(picture(scene, boundary=edges)) / area - 1 for edges in (False, True))
            slopes = (
                _sum(forward(scene, "spheres.ball.radius", boundary=edges)) / by_radius - 1
                for edges in (False, True)
            )
            errors.append([*areas, *slopes])
        for label, error in zip(
            ("plain area", "area with edges", "plain AD", "AD with edges"),
            np.array(errors).T,
            strict=True,
        ):
            curves.append(Curve(f"{label}, {p.name}", sides, abs(error)))
    return Chart(
        "A sphere's silhouette and its derivative by the radius",
        "pixels along a side",
        "relative error",
        tuple(curves),
        1e-2,
    )


# 26: jumps that vanish

KEPT = (0.0, 0.5, 0.9, 0.99, 0.999, 1.0)


def _fading(p: Precision, reflection: float) -> tuple[Scene, float]:
    """A mirror ball in a white sky, which differs from it by 1 - reflection: the scene, and d area
    / d radius.
    """
    scene, _, by_radius, _ = _silhouette(p, 32)
    values = {
        "ambient": [0, 0, 0],
        "background": [1, 1, 1],
        "materials.white.reflection": reflection,
    }
    return scene.replace(values), by_radius


def fading(p: Precision) -> Iterator[Check]:
    for kept in KEPT:
        scene, by_radius = _fading(p, kept)
        expected = -(1 - kept) * by_radius
        # A jump fainter than is looked for is left to the samples, which lose no more than it
        bound = (2e-3 if 1 - kept > 1 / 32 else 1.001 * (1 - kept) + 8 * p.epsilon) * by_radius
        yield from slope_checks(
            scene,
            "spheres.ball.radius",
            None,
            expected,
            bound / (abs(expected) or 1),
            4,
            boundary=True,
        )
    rim = scene_of(
        p,
        SKY,
        camera((0, 0, 4), (0, 0, 0), 40, (32, 32)),
        GLASS,
        ball("ball", (0, 0, 0), 0.9, "glass"),
    )
    yield from finite_checks(rim, "Fresnel rim", "spheres.ball.radius", boundary=True)
    yield from finite_checks(rim, "Fresnel rim, index", "materials.glass.ior", boundary=True)


def fading_chart() -> Chart:
    jumps, curves = np.logspace(-5, 0, 21), []
    for p in PRECISIONS:
        for label, edges in (("plain AD", False), ("AD with edges", True)):
            errors = []
            for jump in rounded(p, jumps).tolist():
                scene, by_radius = _fading(p, 1 - jump)
                errors.append(
                    abs(
                        _sum(forward(scene, "spheres.ball.radius", None, 4, boundary=edges))
                        / by_radius
                        + jump
                    )
                )
            curves.append(Curve(f"{label}, {p.name}", jumps, np.array(errors)))
    title = "d sum / d radius of a ball that fades into its background"
    return Chart(
        title, "jump of radiance at the edge", "error over d area / d radius", tuple(curves), 1e-2
    )


# 28: small, grazing and crossing

AHEAD = camera((0, 0, 4), (0, 0, 0), 40, (32, 32))
RED = material("red", color=[0.7, 0.1, 0.2])


def _speck(p: Precision, radius: float) -> tuple[Scene, float]:
    """A sphere about as small as a pixel, beside its centre: the scene, and d area / d radius."""
    scene = scene_of(p, GLOW, AHEAD, WHITE, ball("ball", (0.02, 0.03, 0), radius, "white"))
    f2, d2 = (16 / math.tan(math.radians(20))) ** 2, 16.0
    return scene, 2 * math.pi * f2 * radius * d2 / (d2 - radius**2) ** 2


def small(p: Precision) -> Iterator[Check]:
    pixel = 2 * 4 * math.tan(math.radians(20)) / 32
    for part in (0.05, 0.2, 0.5, 1.5):
        scene, by_radius = _speck(p, part * pixel)
        errors = []
        for spp in (1, 16, 256):
            found = _sum(forward(scene, "spheres.ball.radius", None, spp, boundary=True))
            yield Check(
                f"radius {part} of a pixel, spp {spp}: d sum / d radius, over the right one",
                abs(found) / by_radius,
                2,
            )
            errors.append(abs(found / by_radius - 1))
        # Spacing of samples over the radius, at the most of them: unseen from 1/2, a polygon's
        # error below
        spacing = 1 / 16 / part
        yield Check(
            f"radius {part} of a pixel, spp 256: relative error",
            errors[-1],
            1 if spacing > 0.5 else 0.1 * spacing,
        )
        yield Check(
            f"radius {part} of a pixel: error at spp 256, over that at spp 1",
            errors[-1] / max(errors[0], 0.02),
            1,
        )
    walls = wall("floor", (0, 1, 0), 0.001, "red") + wall("side", (1, 0, 0), 0.001, "white")
    pair = ball("near", (0.3, 0.3, 0), 0.4, "red") + ball("far", (-0.3, -0.3, 1), 0.4, "white")
    sky = "background = [0.2, 0.4, 0.9]\n"
    # The walls meet along a diagonal, through samples, and u pixels from the middle they do so u /
    # 0.001 lower for a unit of offset. For the pair a unit is 11 pixels, and no pixel holds more
    # than sqrt(2) of an edge's length, or two edges'
    for what, objects, name, bound in (
        ("grazing edges", walls, "planes.floor.offset", 16 / 0.001),
        ("crossing edges", pair, "spheres.near.radius", 100),
    ):
        scene = scene_of(p, sky, GLOW, AHEAD, RED, WHITE, objects)
        yield from finite_checks(scene, what, name, boundary=True)
        yield Check(
            f"{what}: largest d pixel / d {name}", worst(forward(scene, name, boundary=True)), bound
        )
    whole, red = 16**2 / 2 / 0.001, (0.7 + 0.1 + 0.2) / 3
    scene = scene_of(p, sky, GLOW, AHEAD, RED, WHITE, walls)
    yield from slope_checks(
        scene, "planes.floor.offset", None, whole * (1 - red), 5e-3, boundary=True
    )


def _rings(p: Precision, curves: int, most: int) -> tuple[Scene, float, float]:
    """Silhouettes one around the other within a pixel's width, white and black: the scene, d sum /
    d fov, sum of moduli.
    """
    side, fov = 16, 40.0
    f = side / 2 / math.tan(math.radians(fov) / 2)
    parts: list[str] = []
    values: dict[str, object] = {}
    for k in range(most):
        distance, pixels = 10 + 3 * k, 5 + (k + 0.5) / curves
        angle = math.atan(pixels / f)
        parts.append(ball(f"b{k}", (0, 0, -distance), 1, "white" if (curves - k) % 2 else "black"))
        # Those that are too many lie behind the camera
        values[f"spheres.b{k}.center"] = [0, 0, -distance if k < curves else distance + 100]
        values[f"spheres.b{k}.radius"] = distance * math.sin(angle)
    scene = scene_of(
        p, GLOW, camera((0, 0, 0), (0, 0, -1), fov, (side, side)), WHITE, material("black"), *parts
    )
    areas = math.pi * (5 + (np.arange(curves) + 0.5) / curves) ** 2
    by_fov = -2 * math.radians(1) / math.sin(math.radians(fov)) * areas
    signs = np.where((curves - np.arange(curves)) % 2, 1.0, -1.0)
    return scene.replace(values), float((signs * by_fov).sum()), float(abs(by_fov).sum())


def small_chart() -> Chart:
    counts, curves = np.arange(1, 9), []
    for p, spp in ((SINGLE, 1), (SINGLE, 4), (SINGLE, 16), (DOUBLE, 64)):
        errors = []
        for n in counts.tolist():
            scene, by_fov, size = _rings(p, n, counts.size)
            errors.append(
                abs(_sum(forward(scene, "camera.fov", None, spp, boundary=True)) - by_fov) / size
            )
        curves.append(Curve(f"AD with edges, spp {spp}, {p.name}", counts, np.array(errors)))
    return Chart(
        "Edges within one pixel",
        "edges",
        "error of d sum / d fov, of its parts",
        tuple(curves),
        0.1,
        linear=True,
    )


CASES = (
    Case(
        24,
        "shadow of a sphere",
        "a disc of radius H tan(asin(r / (H - h))); the derivative of its light in closed form",
        "Edges are chords between samples 1/4 of a pixel apart: an error of second order in 1/200 of the disc's radius. In "
        "single precision "
        "a crossing is off by the root of a rounding at most, and sums of 1e6 samples by some 1e-3.",
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
        "an edge counts as its jump, (1 - reflection) L, down to nothing; a Fresnel rim is finite",
        "Of a jump above 1/32 the edge's length is off by a chord's error at 32 x 32, spp 4; a fainter one may be left out, "
        "which is an error "
        "of the jump itself.",
        fading,
        fading_chart,
    ),
    Case(
        28,
        "small and crossing edges",
        "bounded derivatives, whose error falls as spp grows",
        "What no sample hits has no derivative: its error is 1. From two samples a radius on, chords lose less than 1/10 of the "
        "spacing. "
        "A derivative is at most an edge's length in a pixel times its speed.",
        small,
        small_chart,
    ),
)
