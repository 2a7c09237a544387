"""Hard cases of a sphere of glass: 12 to 15."""

import math
from collections.abc import Iterator
from functools import partial

import drjit as dr
import numpy as np

from ..core.arrays import PRECISIONS, Array, Precision, precision_of
from ..tracing.optics import reflect, refract, transmission
from .arrays import numbers_of, rounded, slopes, worst
from .case import Case, Chart, Check, Curve
from .chains import follow, parallel_rays
from .scenes import (
    CLEAR,
    GLASS,
    PIXEL,
    WHITE_AMBIENT,
    WHITE_SKY,
    ball,
    camera,
    material,
    picture,
    scene_of,
    wall,
)

# 12 and 13: how far a ray is turned


def deviation(theta: Array, n: Array, bounces: int = 0) -> Array:
    """The angle by which a sphere turns a ray that is reflected inside so many times.

    Each turn is computed from the sine of half of it, or of half of what remains to pi, whichever
    is smaller. So it is exact to rounding at every angle. (Dr.Jit's arc tangent aborts the process
    before LLVM 20.)

    Args:
        theta: the angle of incidence.
        n: the index of the sphere over that around it.
    """
    real = type(theta)
    vector = precision_of(theta).vector
    p, d, turned = vector(0, 1, 0), vector(dr.sin(theta), -dr.cos(theta), 0), real(0)
    for k in range(bounces + 2):
        entering, reflecting = k == 0, 0 < k <= bounces
        normal = p if entering else -p
        cosine = -dr.dot(d, normal)
        eta = 1 / n if entering else n
        squared, _ = transmission(cosine, eta)
        out = (
            reflect(d, normal) if reflecting else refract(d, normal, cosine, dr.sqrt(squared), eta)
        )
        out = dr.normalize(out)
        acute = dr.dot(d, out) > 0
        angle = 2 * dr.asin(dr.norm(dr.select(acute, out - d, out + d)) / 2)
        turned += dr.select(acute, angle, dr.pi - angle)
        d = out
        # The next point, on the other end of the chord
        p = p - 2 * dr.dot(p, d) * d
    return turned


def _deviation_by_index(p: Precision, theta: float, bounces: int, n: Array) -> Array:
    return deviation(dr.opaque(p.real, theta), n, bounces)


def _expected_deviation(theta: float, n: float, bounces: int) -> tuple[float, float]:
    """2 (ti - tt) + k (pi - 2 tt) after k bounces, and its derivative by n."""
    inner = math.asin(math.sin(theta) / n)
    turn = 2 * (theta - inner) + bounces * (math.pi - 2 * inner)
    return turn, 2 * (1 + bounces) * math.tan(inner) / n


def _deviation_checks(p: Precision, theta: float, n: float, bounces: int) -> Iterator[Check]:
    expected, by_n = _expected_deviation(theta, n, bounces)
    function = partial(_deviation_by_index, p, theta, bounces)
    value, forward, reverse = slopes(function, dr.opaque(p.real, n))
    steps = bounces + 2
    error = worst(value / expected - 1)
    yield Check(f"{bounces} bounces: turn, relative", error, 4 * steps * p.epsilon)
    for mode, slope in (("forward", forward), ("reverse", reverse)):
        what = f"{bounces} bounces: d turn / d n, {mode}, relative"
        yield Check(what, worst(slope / by_n - 1), 8 * steps * p.epsilon)


def two_refractions(p: Precision) -> Iterator[Check]:
    yield from _deviation_checks(p, math.radians(45), 1.5, 0)


def rainbow(p: Precision) -> Iterator[Check]:
    for bounces in (1, 2, 5):
        yield from _deviation_checks(p, math.radians(40), 1.5, bounces)
    n = 4 / 3
    # Descartes' ray, which a drop turns least
    theta = math.acos(math.sqrt((n * n - 1) / 3))
    error = abs(math.degrees(theta) - 59.391)
    yield Check("incidence of the least turn, in degrees, from 59.391", error, 5e-4)
    value, forward, reverse = slopes(
        lambda theta: deviation(theta, dr.opaque(p.real, n), 1), dr.opaque(p.real, theta)
    )
    error, bound = worst(np.degrees(value) - 137.970), 5e-4 + 180 * 12 * p.epsilon
    yield Check("least turn, in degrees, from 137.970", error, bound)
    # Terms of sizes up to 4 cancel
    for mode, slope in (("forward", forward), ("reverse", reverse)):
        yield Check(f"d turn / d incidence there, {mode}", worst(slope), 32 * p.epsilon)


def rainbow_chart() -> Chart:
    bounces = np.array([1, 2, 4, 8, 16])
    theta, n = math.radians(59), 4 / 3
    curves = []
    for p in PRECISIONS:
        errors = []
        for k in bounces.tolist():
            function = partial(_deviation_by_index, p, theta, k)
            value, _, reverse = slopes(function, dr.opaque(p.real, n))
            expected, by_n = _expected_deviation(theta, n, k)
            errors.append((abs(value[0] / expected - 1), abs(reverse[0] / by_n - 1)))
        of_turn, of_slope = np.array(errors).T
        curves.append(Curve(f"turn, {p.name}", bounces, of_turn))
        curves.append(Curve(f"its derivative by n, {p.name}", bounces, of_slope))
    title = "Turn of a ray that bounces inside a sphere"
    return Chart(
        title, "number of bounces", "relative error (1 is 100 %)", tuple(curves), 1e-4, linear=True
    )


# 14: ball lens

HEIGHTS = np.logspace(-3, -0.2, 15)


def _focus(p: Precision, heights: np.ndarray, n: Array) -> Array:
    """Where rays parallel to the axis cross it behind a glass ball, measured from its centre."""
    ball_only = scene_of(p, PIXEL, CLEAR, ball("ball", (0, 0, 0), 1, "clear"))
    scene = ball_only.carrying({"materials.clear.ior": n})
    ray = follow(scene, parallel_rays(p, numbers_of(p, heights)), "tt")
    return -(ray.o.z - ray.o.x * ray.d.z / ray.d.x)


def _expected_focus(heights: np.ndarray, n: float) -> tuple[np.ndarray, np.ndarray]:
    """h / sin(turn) at heights h, and its derivative by n; d turn / d n = 2 tan(tt) / n."""
    turn = 2 * (np.arcsin(heights) - np.arcsin(heights / n))
    focus = heights / np.sin(turn)
    by_n = -focus / np.tan(turn) * 2 * heights / n**2 / np.sqrt(1 - (heights / n) ** 2)
    return focus, by_n


def ball_lens(p: Precision) -> Iterator[Check]:
    heights = rounded(p, HEIGHTS)
    # Growth of a relative error with the height
    growth = p.epsilon / heights
    for n in (1.5, 2.0):
        expected, by_n = _expected_focus(heights, n)
        value, forward, reverse = slopes(
            lambda n: _focus(p, HEIGHTS, n), dr.full(p.real, n, heights.size)
        )
        error = worst((value / expected - 1) / growth) * p.epsilon
        yield Check(f"n = {n}: focus, relative error times the height", error, 8 * p.epsilon)
        for mode, slope in (("forward", forward), ("reverse", reverse)):
            error = worst((slope / by_n - 1) / growth) * p.epsilon
            what = f"n = {n}: d focus / d n, {mode}, relative error times the height"
            yield Check(what, error, 16 * p.epsilon)
        paraxial = n / (2 * (n - 1))
        # Spherical aberration is of second order in the height, with factors below 1
        aberration = abs(value - paraxial) / (heights**2 + 8 * growth)
        what = f"n = {n}: focus from n D / 4 (n - 1) = {paraxial:g}, over the height squared"
        yield Check(what, worst(aberration), 1)


def ball_lens_chart() -> Chart:
    heights, curves = np.logspace(-6, -0.1, 30), []
    for p in PRECISIONS:
        expected, _ = _expected_focus(rounded(p, heights), 1.5)
        focus = _focus(p, heights, dr.full(p.real, 1.5, heights.size)).numpy()
        curves.append(Curve(f"traced, {p.name}", heights, abs(focus / expected - 1)))
    curves.append(Curve("paraxial formula, double", heights, abs(1.5 / expected - 1)))
    return Chart(
        "Focus of a ball lens",
        "height of the ray above the axis (radii)",
        "relative error (1 is 100 %)",
        tuple(curves),
        1e-2,
    )


# 15: furnace

# At 45 degrees, n = 1.5
REFLECTANCE = 0.05023991101223595
# A pixel whose ray meets the unit sphere at 45 degrees
SIDE = camera((math.sqrt(0.5), 0, 5), (math.sqrt(0.5), 0, 0), 1, (1, 1))


def furnace(p: Precision) -> Iterator[Check]:
    scene = scene_of(p, WHITE_SKY, SIDE, GLASS, ball("ball", (0, 0, 0), 1, "glass"))
    for depth in (2, 3, 5, 9):
        expected = 1 - (1 - REFLECTANCE) * REFLECTANCE ** (depth - 2)
        error = worst(picture(scene, max_depth=depth) - expected)
        yield Check(f"glass at 45 degrees, depth {depth}", error, 8 * p.epsilon)


def furnace_chart() -> Chart:
    depths, curves = np.arange(2, 13), []
    mirror = material("mirror", reflection=0.5, color=[0.5, 0.5, 0.5])
    walls = wall("one", (0, 0, 1), 1, "mirror") + wall("two", (0, 0, -1), 6, "mirror")
    for p in PRECISIONS:
        scenes = {
            "glass": scene_of(p, WHITE_SKY, SIDE, GLASS, ball("ball", (0, 0, 0), 1, "glass")),
            "facing mirrors that reflect half": scene_of(p, WHITE_AMBIENT, PIXEL, mirror, walls),
        }
        for label, scene in scenes.items():
            lost = [abs(1 - picture(scene, max_depth=depth)[0, 0, 0]) for depth in depths.tolist()]
            curves.append(Curve(f"{label}, {p.name}", depths, np.array(lost)))
    return Chart(
        "Radiance lost beyond max_depth, where all radiance is 1",
        "max_depth (nodes)",
        "missing radiance (of 1)",
        tuple(curves),
        1e-2,
        linear=True,
    )


CASES = (
    Case(
        12,
        "two refractions",
        "2 (ti - tt) = 33.7490 deg through a sphere at 45 deg, n = 1.5; "
        "d/dn = 2 tan(tt) / n = 0.712697",
        "Each interface rounds a direction by about 2 ulp. tan(tt) is below 1, so errors are not "
        "magnified: 4 ulp for each interface, 8 for the derivative.",
        two_refractions,
    ),
    Case(
        13,
        "rainbow",
        "2 (ti - tt) + k (pi - 2 tt) after k bounces; for n = 4/3 and k = 1 it is least, 137.970 "
        "deg, at 59.391 deg",
        "As for two refractions, with as much again for each bounce.",
        rainbow,
        rainbow_chart,
    ),
    Case(
        14,
        "ball lens",
        "focus at n D / 4 (n - 1) from the centre: for D = 2 at 1.5 if n = 1.5, and at the rear "
        "surface if n = 2",
        "The focus is a height over a slope, both of size h and off by a few ulp(1), so it is off "
        "by ulp / h, relatively. Spherical aberration is below h^2.",
        ball_lens,
        ball_lens_chart,
        "away from the origin, rays within 1e-5 radii of the axis lose all but two digits",
    ),
    Case(
        15,
        "furnace",
        "where all radiance is 1, glass shows 1 - (1 - R) R^N after N surfaces inside; "
        "R = 0.050240 at 45 deg",
        "Weights are products of a few factors below 1, each rounded.",
        furnace,
        furnace_chart,
    ),
)
