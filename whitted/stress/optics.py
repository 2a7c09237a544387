"""Hard cases of an interface between two media: 8 to 13."""

import math
from collections.abc import Callable, Iterator
from functools import partial

import drjit as dr
import numpy as np
from drjit.llvm import ad

from ..core.arrays import PRECISIONS, Array, Precision
from ..tracing.optics import fresnel, reflect, refract, transmission
from .case import Case, Chart, Check, Curve, count, slopes, worst
from .scenes import WHITE, ball, camera, finite_checks, lamp, material, picture, scene_of, wall

CRITICAL = math.asin(1 / 1.5)


def reflectance(cosine: Array, n: Array) -> Array:
    """Of an interface, where n is the index behind it over the one before it; 1 under total
    internal reflection.
    """
    squared, total = transmission(cosine, 1 / n)
    positive = squared > 0
    cos_theta_t = dr.select(positive, dr.sqrt(dr.select(positive, squared, 1)), 0)
    return dr.select(total, 1, fresnel(cosine, cos_theta_t, 1 / n))


def textbook(theta: np.ndarray, n: float) -> tuple[np.ndarray, np.ndarray]:
    """Reflectance and its derivative by n from the angles of incidence, in NumPy's longest
    precision, n not 1.

    R_s = (sin(i - t) / sin(i + t))^2, R_p = (tan(i - t) / tan(i + t))^2, and dt / dn = -tan(t) / n.
    """
    i = np.asarray(theta, np.longdouble)
    t = np.arcsin(np.sin(i) / np.longdouble(n))
    s, p = (np.sin(i - t) / np.sin(i + t)) ** 2, (np.tan(i - t) / np.tan(i + t)) ** 2
    by_t = -2 * s * (1 / np.tan(i - t) + 1 / np.tan(i + t))
    by_t -= 4 * p * (1 / np.sin(2 * (i - t)) + 1 / np.sin(2 * (i + t)))
    return (s + p) / 2, by_t / 2 * -np.tan(t) / n


def _at(p: Precision, degrees: float, n: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reflectance at an angle, and its derivative by n, forward and reverse."""
    cosine = dr.opaque(p.real, math.cos(math.radians(degrees)))
    return slopes(lambda n: reflectance(cosine, n), dr.opaque(p.real, n))


# 8: index 1


def index_one(p: Precision) -> Iterator[Check]:
    cosine = p.real(
        np.concatenate([np.linspace(0, 1, 1001), 2.0 ** -np.arange(1, 60)]).astype(p.dtype)
    )
    value, forward, reverse = slopes(
        lambda n: reflectance(cosine, n), dr.ones(p.real, dr.width(cosine))
    )
    yield Check("angles with a reflectance other than 0", count(value != 0), 0)
    yield Check("angles with d F / d n other than 0", count((forward != 0) | (reverse != 0)), 0)
    air = material("air", reflection=1, refraction=1, ior=1, fresnel="true")
    # The lamp lies between the ball and the wall, as glass of any index throws a shadow
    room = (
        camera((0.1, 0.2, 4), (0, 0, 0), 40, (24, 24))
        + WHITE
        + air
        + wall("back", (0, 0, 1), 1.5, "white")
        + lamp((2, 2, -1.2))
    )
    scene = scene_of(p, room, ball("ball", (0.1, 0, 0), 0.9, "air"))
    yield Check(
        "image minus the one without the sphere",
        worst(picture(scene) - picture(scene_of(p, room))),
        32 * p.epsilon,
    )
    yield from finite_checks(scene, "a ball of index 1", "materials.air.ior")


def normal_incidence(p: Precision) -> Iterator[Check]:
    value, forward, reverse = _at(p, 0, 1.5)
    yield Check("reflectance, relative to 0.04", worst(value / 0.04 - 1), 12 * p.epsilon)
    yield Check("d F / d n, forward, relative to 0.128", worst(forward / 0.128 - 1), 24 * p.epsilon)
    yield Check("d F / d n, reverse, relative to 0.128", worst(reverse / 0.128 - 1), 24 * p.epsilon)


def brewster(p: Precision) -> Iterator[Check]:
    theta = math.atan(1.5)
    value, forward, reverse = _at(p, math.degrees(theta), 1.5)
    perpendicular = math.cos(2 * theta) ** 2  # sin(i - t)^2, as i + t is a right angle
    yield Check(
        "parallel reflectance, what is left of 2 F - R_s",
        worst(2 * value - perpendicular),
        8 * p.epsilon * perpendicular,
    )
    _, by_n = textbook(np.array(theta), 1.5)
    for mode, slope in (("forward", forward), ("reverse", reverse)):
        yield Check(f"d F / d n, {mode}, relative", worst(slope / float(by_n) - 1), 24 * p.epsilon)


# 11: the critical angle


def critical(p: Precision) -> Iterator[Check]:
    beyond = dr.cos(p.real(np.radians([41.82, 45, 60, 80, 89.9]).astype(p.dtype)))
    value, forward, reverse = slopes(lambda n: reflectance(beyond, n), dr.full(p.real, 1 / 1.5, 5))
    yield Check("beyond: reflectances other than 1", count(value != 1), 0)
    yield Check("beyond: derivatives other than 0", count((forward != 0) | (reverse != 0)), 0)
    around = np.concatenate([-np.logspace(-16, -1, 61), [0], np.logspace(-16, -1, 61)])
    everything = slopes(*_near(p, around))
    yield Check("around: not finite", count(~np.isfinite(everything)), 0)
    # What is left of the relative error when its growth, ulp / (distance to the angle), is taken
    # out
    inside = np.logspace(math.log10(64 * p.epsilon), -1.5, 40)
    for name, errors in zip(("forward", "reverse"), _slope_errors(p, inside), strict=True):
        yield Check(
            f"just inside: d F / d n, {name}, relative, times the distance",
            worst(errors * inside),
            4 * p.epsilon,
        )


def _near(p: Precision, inside: np.ndarray) -> tuple[Callable[[Array], Array], Array]:
    """Reflectance as a function of the index, at angles so far inside the critical one."""
    cosine = p.real(np.cos(CRITICAL - inside).astype(p.dtype))
    return lambda n: reflectance(cosine, n), dr.full(p.real, 1 / 1.5, len(inside))


def _slope_errors(p: Precision, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors of the derivative by the index, forward and reverse."""
    _, expected = textbook(CRITICAL - inside.astype(np.longdouble), 1 / 1.5)
    _, forward, reverse = slopes(*_near(p, inside))
    return forward / expected.astype(np.float64) - 1, reverse / expected.astype(np.float64) - 1


def critical_chart() -> Chart:
    inside = np.logspace(-14, -1, 53)
    curves = [
        Curve(
            f"derivative by automatic differentiation, {p.name}",
            inside,
            abs(_slope_errors(p, inside)[1]),
        )
        for p in PRECISIONS
    ]
    cosine = math.cos
    for step in (1e-4, 1e-7):
        ends = [
            np.array([_double(cosine(CRITICAL - x), 1 / 1.5 + h) for x in inside])
            for h in (-step, step)
        ]
        expected = textbook(CRITICAL - inside.astype(np.longdouble), 1 / 1.5)[1].astype(np.float64)
        curves.append(
            Curve(
                f"differences, step {step:g}, double",
                inside,
                abs((ends[1] - ends[0]) / (2 * step) / expected - 1),
            )
        )
    title = "Fresnel reflectance just inside the critical angle: its slope is infinite there"
    return Chart(
        title,
        "angle inside the critical one, radians",
        "relative error of dF/dn",
        tuple(curves),
        1e-2,
    )


def _double(cosine: float, n: float) -> float:
    """Reflectance in Python's numbers."""
    squared = 1 - (1 - cosine * cosine) / n**2
    if squared <= 0:
        return 1.0
    t = math.sqrt(squared)
    return (
        ((cosine - n * t) / (cosine + n * t)) ** 2 + ((n * cosine - t) / (n * cosine + t)) ** 2
    ) / 2


# 12 and 13: through a sphere


def deviation(theta: Array, n: Array, bounces: int = 0) -> Array:
    """The angle that a ray is turned by which meets a sphere at theta: into it, k reflections, out
    of it.

    Each turn is taken from the sine of its half, or of the half of what is left to pi, whichever is
    smaller: exact to rounding at every angle. (Dr.Jit's arc tangent aborts the process before LLVM
    20.)
    """
    real = type(theta)
    vector = {ad.Float: ad.Array3f, ad.Float64: ad.Array3f64}[real]
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
        p = p - 2 * dr.dot(p, d) * d
    return turned


def _turned(p: Precision, theta: float, bounces: int, n: Array) -> Array:
    return deviation(dr.opaque(p.real, theta), n, bounces)


def two_refractions(p: Precision) -> Iterator[Check]:
    yield from _deviations(p, math.radians(45), 1.5, 0)


def _deviations(p: Precision, theta: float, n: float, bounces: int) -> Iterator[Check]:
    """The turn and its derivative by the index, against 2 (ti - tt) + k (pi - 2 tt)."""
    inner = math.asin(math.sin(theta) / n)
    expected = 2 * (theta - inner) + bounces * (math.pi - 2 * inner)
    by_n = 2 * (1 + bounces) * math.tan(inner) / n
    value, forward, reverse = slopes(partial(_turned, p, theta, bounces), dr.opaque(p.real, n))
    steps = bounces + 2
    yield Check(
        f"{bounces} bounces: turn, relative", worst(value / expected - 1), 4 * steps * p.epsilon
    )
    for mode, slope in (("forward", forward), ("reverse", reverse)):
        yield Check(
            f"{bounces} bounces: d turn / d n, {mode}, relative",
            worst(slope / by_n - 1),
            8 * steps * p.epsilon,
        )


def rainbow(p: Precision) -> Iterator[Check]:
    for bounces in (1, 2, 5):
        yield from _deviations(p, math.radians(40), 1.5, bounces)
    n = 4 / 3
    at = math.acos(math.sqrt((n * n - 1) / 3))
    yield Check(
        "angle of the least turn, in degrees, from 59.391", abs(math.degrees(at) - 59.391), 5e-4
    )
    value, forward, reverse = slopes(
        lambda theta: deviation(theta, dr.opaque(p.real, n), 1), dr.opaque(p.real, at)
    )
    yield Check(
        "least turn, in degrees, from 137.970",
        worst(np.degrees(value) - 137.970),
        5e-4 + 180 * 12 * p.epsilon,
    )
    # Terms of sizes up to 4 cancel
    for mode, slope in (("forward", forward), ("reverse", reverse)):
        yield Check(f"d turn / d angle there, {mode}", worst(slope), 32 * p.epsilon)


def rainbow_chart() -> Chart:
    bounces = np.array([1, 2, 4, 8, 16])
    theta, n = math.radians(59), 4 / 3
    inner = math.asin(math.sin(theta) / n)
    expected = 2 * (theta - inner) + bounces * (math.pi - 2 * inner)
    curves = []
    for p in PRECISIONS:
        turns, by_n = [], []
        for k in bounces.tolist():
            value, _, reverse = slopes(partial(_turned, p, theta, k), dr.opaque(p.real, n))
            turns.append(value[0])
            by_n.append(reverse[0])
        exact = 2 * (1 + bounces) * math.tan(inner) / n
        curves.append(Curve(f"turn, {p.name}", bounces, abs(np.array(turns) / expected - 1)))
        curves.append(
            Curve(f"its derivative by n, {p.name}", bounces, abs(np.array(by_n) / exact - 1))
        )
    return Chart(
        "Bounces inside a sphere", "bounces", "relative error", tuple(curves), 1e-4, linear=True
    )


CASES = (
    Case(
        8,
        "index one",
        "F = 0 and dF/dn = 0 at every angle, never NaN; the image is that of the scene without the sphere",
        "Exact zeros, by the order of the sums. A ray that passes through restarts at two rounded points: colours of a smooth "
        "wall, "
        "whose slopes are at most 1, are off by some 4 roundings of numbers up to 5.",
        index_one,
    ),
    Case(
        9,
        "normal incidence",
        "F = ((n - 1) / (n + 1))^2 = 0.04 and dF/dn = 4 (n - 1) / (n + 1)^3 = 0.128 at n = 1.5",
        "1 / n, and n - 1 formed from it, are off by 1 ulp of 1 / 3; squares double that: 12 ulp, twice that for the derivative.",
        normal_incidence,
    ),
    Case(
        10,
        "Brewster angle",
        "at atan(1.5) = 56.3099 deg the parallel reflectance is 0",
        "The parallel amplitude is a rounding, its square nothing; the perpendicular one is off by some 3 ulp, its square by 8.",
        brewster,
    ),
    Case(
        11,
        "critical angle",
        "F = 1 beyond asin(1 / 1.5) = 41.8103 deg; just inside its slope is infinite, and computed finite",
        "cos_t^2 = 2 tan(critical) x is a difference of numbers near 1, off by some 2 ulp: the slope ~ 1 / cos_t is off by 2 "
        "ulp / x, "
        "relatively, and the cosine of the angle itself by as much.",
        critical,
        critical_chart,
        "1e-5 inside the critical angle the slope has two digits, below 1e-6 none",
    ),
    Case(
        12,
        "two refractions",
        "2 (ti - tt) = 33.7490 deg through a sphere at 45 deg, n = 1.5; d/dn = 2 tan(tt) / n = 0.712697",
        "Each interface rounds a direction by some 2 ulp; tan(tt) is below 1, so that errors are not magnified: 4 ulp each, 8 "
        "of slopes.",
        two_refractions,
    ),
    Case(
        13,
        "rainbow",
        "2 (ti - tt) + k (pi - 2 tt); for n = 4/3, k = 1 least, 137.970 deg, at 59.391 deg",
        "As for two refractions, and as much again for each bounce.",
        rainbow,
        rainbow_chart,
    ),
)
