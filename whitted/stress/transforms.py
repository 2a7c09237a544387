"""Hard cases of scale and position: 3 to 5."""

from collections.abc import Iterator

import numpy as np

from ..core.arrays import PRECISIONS, Precision
from ..scene.scene import Scene
from .arrays import worst
from .case import Case, Chart, Check, Curve
from .scenes import (
    GLASS,
    WHITE,
    ball,
    camera,
    finite_checks,
    forward,
    lamp,
    material,
    picture,
    reverse,
    scene_of,
    wall,
)

RED = material("red", color=[0.8, 0.3, 0.2], specular=0.4, reflection=0.2)
DIM = "background = [0.2, 0.3, 0.5]\nambient = [0.1, 0.1, 0.1]\n"
CENTER = "spheres.red.center"


def error_quantile(image: np.ndarray, expected: np.ndarray, share: float) -> float:
    """The error that this share of the pixels does not exceed, of the worst channel."""
    return float(np.quantile(abs(image - expected).max(-1), share))


# 3 and 4: scaled and moved


def _room(p: Precision, scale: float = 1.0, shift: float = 0.0) -> Scene:
    """Glass, a mirror and shadows; positions are scaled, then moved by `shift` on each axis."""

    def place(*x: float) -> list[float]:
        return [a * scale + shift for a in x]

    glass = ball("glass", place(-0.6, 0, 0), 0.6 * scale, "glass")
    red = ball("red", place(0.7, -0.2, 0.3), 0.5 * scale, "red")
    floor = wall("floor", (0, 1, 0), scale - shift, "red")
    view = camera(place(0, 0.5, 4), place(0, 0, 0), 45, (48, 48))
    light = lamp(place(1, 3, 2), (1, 0.9, 0.8))
    return scene_of(p, DIM, view, GLASS, RED, glass, red, floor, light)


def scaled(p: Precision) -> Iterator[Check]:
    image, by_forward = picture(_room(p)), forward(_room(p), CENTER, "x")
    by_reverse = reverse(_room(p), CENTER)[CENTER]
    for scale in (1e-4, 1e-2, 1e2, 1e4):
        scene = _room(p, scale)
        error, bound = error_quantile(picture(scene), image, 0.99), min(1e-5, 100 * p.epsilon)
        yield Check(f"scale {scale:g}: image, 99 % of its pixels", error, bound)
        slope = forward(scene, CENTER, "x") * scale
        error, bound = error_quantile(slope, by_forward, 0.99), 100 * p.epsilon * worst(by_forward)
        yield Check(f"scale {scale:g}: d image / d center, 99 % of its pixels", error, bound)
        slopes = reverse(scene, CENTER)[CENTER] * scale
        # One sample that a rounding moves across an edge may change a sum of thousands
        error, bound = worst(slopes - by_reverse), 0.01 if p.name == "single" else 1e-7
        yield Check(
            f"scale {scale:g}: d sum / d center, relative", error / worst(by_reverse), bound
        )


def scaled_chart() -> Chart:
    scales, curves = np.logspace(-16, 16, 17), []
    for p in PRECISIONS:
        image = picture(_room(p))
        images = [picture(_room(p, scale)) for scale in scales.tolist()]
        for share in (0.9, 0.99):
            errors = np.array([error_quantile(scaled, image, share) for scaled in images])
            curves.append(Curve(f"{share:.0%} of the pixels, {p.name}", scales, errors))
    title = "The same scene at other scales"
    return Chart(title, "factor of scale", "difference of pixels (radiance)", tuple(curves), 1e-4)


def moved(p: Precision) -> Iterator[Check]:
    image = picture(_room(p))
    for shift in (1e3, 1e4, 1e5):
        scene, ulp = _room(p, shift=shift), p.epsilon * shift
        moved_image = picture(scene)
        error = error_quantile(moved_image, image, 0.9)
        yield Check(f"by {shift:g}: 90 % of the pixels", error, 2 * ulp)
        wrong = abs(moved_image - image).max(-1) > max(0.02, 10 * ulp)
        what = f"by {shift:g}: share of pixels with acne or beside an edge"
        yield Check(what, float(wrong.mean()), 0.05)
        yield from finite_checks(scene, f"by {shift:g}", "spheres.glass.center", "x")


def moved_chart() -> Chart:
    shifts, curves = np.logspace(0, 7, 15), []
    for p in PRECISIONS:
        image = picture(_room(p))
        errors = [
            error_quantile(picture(_room(p, shift=shift)), image, 0.9) for shift in shifts.tolist()
        ]
        curves.append(Curve(f"90% of the pixels, {p.name}", shifts, np.array(errors)))
        curves.append(Curve(f"2 ulp(position), {p.name}", shifts, 2 * p.epsilon * shifts))
    title = "The same scene far from the origin"
    return Chart(
        title,
        "distance moved (scene units)",
        "difference of pixels (radiance)",
        tuple(curves),
        1e-2,
    )


# 5: a huge sphere as the ground


def _ground_scene(p: Precision, radius: float | None) -> Scene:
    """A ball on a ground that is a sphere of this radius, or a plane if it is None."""
    mirror = material("mirror", color=[0.5, 0.4, 0.3], reflection=0.5)
    if radius is None:
        below = wall("ground", (0, 1, 0), 1, "mirror")
    else:
        below = ball("ground", (0, -radius - 1, 0), radius, "mirror")
    view = camera((0, 0.7, 4), (0, 0, 0), 45, (48, 48))
    white = ball("ball", (0.2, 0.2, 0), 0.6, "white")
    return scene_of(p, DIM, view, WHITE, mirror, white, below, lamp((1, 3, 2)))


def _near_ground(p: Precision, radius: float | None) -> np.ndarray:
    """The rows of the image that show ground at most about 10 units away."""
    return picture(_ground_scene(p, radius))[30:]


def ground(p: Precision) -> Iterator[Check]:
    flat = _near_ground(p, None)
    for radius in (1e4, 1e6):
        error = error_quantile(_near_ground(p, radius), flat, 0.99)
        # Heights are off by 50 / r, and slopes by 10 / r
        bound = 60 / radius + 300 * p.epsilon
        yield Check(f"radius {radius:g}: 99 % of the near pixels", error, bound)
    yield from finite_checks(_ground_scene(p, 1e6), "radius 1e6", "spheres.ground.radius")


def ground_chart() -> Chart:
    radii, curves = np.logspace(1, 9, 17), []
    for p in PRECISIONS:
        flat = _near_ground(p, None)
        errors = [error_quantile(_near_ground(p, radius), flat, 0.99) for radius in radii.tolist()]
        curves.append(Curve(f"99% of the near pixels, {p.name}", radii, np.array(errors)))
    curves.append(Curve("sagitta at 10 units, double", radii, 50 / radii))
    title = "A huge sphere in place of a plane"
    return Chart(
        title, "radius (scene units)", "difference of pixels (radiance)", tuple(curves), 1e-2
    )


CASES = (
    Case(
        3,
        "scaled scene",
        "the same image; derivatives by positions are 1 / s as large",
        "Scaling by a power of ten rounds each number once; glass magnifies that up to a "
        "hundredfold. Of 2304 pixels, 1 % may lie on an edge that a rounding moves across a "
        "sample.",
        scaled,
        scaled_chart,
        "numbers overflow where squares of lengths do, at scales of 1e18 and 1e-18",
    ),
    Case(
        4,
        "moved scene",
        "no acne; an error that grows like ulp(position)",
        "Positions are rounded to half an ulp(shift) on each axis, and colours have slopes of "
        "about 1: 2 ulp for most pixels. Acne would darken a large share of bright pixels.",
        moved,
        moved_chart,
        "moved by 1e5 radii, a position has two digits after the point, and so have pixels",
    ),
    Case(
        5,
        "ground sphere",
        "a sphere of radius 1e6 shows the plane's image, up to its sagitta x^2 / 2 r",
        "At 10 units the ground is 50 / r lower, and its normal is turned by 10 / r; colours have "
        "slopes below 1. Sums are compensated, so a height above the ground is rounded like a "
        "number of size 1 at any radius.",
        ground,
        ground_chart,
    ),
)
