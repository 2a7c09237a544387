"""Hard cases of Fresnel reflectance at an interface of two media: 8 to 11."""

import math
from collections.abc import Callable, Iterator

import drjit as dr
import numpy as np

from ..core.arrays import PRECISIONS, Array, Precision
from ..tracing.optics import fresnel, transmission
from .arrays import count, numbers_of, slopes, worst
from .case import Case, Chart, Check, Curve
from .scenes import WHITE, ball, camera, finite_checks, lamp, material, picture, scene_of, wall

# From the denser side of an interface whose index ratio is 1.5
CRITICAL = math.asin(1 / 1.5)


def reflectance(cosine: Array, n: Array) -> Array:
    """The reflectance of an interface, 1 under total internal reflection.

    Args:
        cosine: of the angle of incidence.
        n: the index behind the interface over the one before it.
    """
    squared, total = transmission(cosine, 1 / n)
    positive = squared > 0
    cos_theta_t = dr.select(positive, dr.sqrt(dr.select(positive, squared, 1)), 0)
    return dr.select(total, 1, fresnel(cosine, cos_theta_t, 1 / n))


def textbook(theta: np.ndarray, n: float) -> tuple[np.ndarray, np.ndarray]:
    """Reflectance and its derivative by n, as long doubles, from the angle of incidence.

    R_s = (sin(i - t) / sin(i + t))^2, R_p = (tan(i - t) / tan(i + t))^2, and dt / dn = -tan(t) / n,
    where i and t are the angles of incidence and transmission. n must not be 1.
    """
    i = np.asarray(theta, np.longdouble)
    t = np.arcsin(np.sin(i) / np.longdouble(n))
    s, p = (np.sin(i - t) / np.sin(i + t)) ** 2, (np.tan(i - t) / np.tan(i + t)) ** 2
    by_t = -2 * s * (1 / np.tan(i - t) + 1 / np.tan(i + t))
    by_t -= 4 * p * (1 / np.sin(2 * (i - t)) + 1 / np.sin(2 * (i + t)))
    return (s + p) / 2, by_t / 2 * -np.tan(t) / n


def _reflectance_at(
    p: Precision, degrees: float, n: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reflectance at an angle, and its derivative by n in forward and in reverse mode."""
    cosine = dr.opaque(p.real, math.cos(math.radians(degrees)))
    return slopes(lambda n: reflectance(cosine, n), dr.opaque(p.real, n))


# 8: index 1


def index_one(p: Precision) -> Iterator[Check]:
    cosines = np.concatenate([np.linspace(0, 1, 1001), 2.0 ** -np.arange(1, 60)])
    cosine = numbers_of(p, cosines)
    one = dr.ones(p.real, dr.width(cosine))
    value, forward, reverse = slopes(lambda n: reflectance(cosine, n), one)
    yield Check("angles with F other than 0", count(value != 0), 0)
    yield Check("angles with dF/dn other than 0", count((forward != 0) | (reverse != 0)), 0)
    air = material("air", reflection=1, refraction=1, ior=1, fresnel="true")
    view = camera((0.1, 0.2, 4), (0, 0, 0), 40, (24, 24))
    # The lamp is between the ball and the wall: a refracting ball of any index casts a shadow
    room = view + WHITE + air + wall("back", (0, 0, 1), 1.5, "white") + lamp((2, 2, -1.2))
    scene = scene_of(p, room, ball("ball", (0.1, 0, 0), 0.9, "air"))
    error = picture(scene) - picture(scene_of(p, room))
    yield Check("image, from that without the sphere", worst(error), 32 * p.epsilon)
    yield from finite_checks(scene, "ball of index 1", "materials.air.ior")


# 9 and 10: angles with simple answers


def normal_incidence(p: Precision) -> Iterator[Check]:
    value, forward, reverse = _reflectance_at(p, 0, 1.5)
    yield Check("F, relative to 0.04", worst(value / 0.04 - 1), 12 * p.epsilon)
    yield Check("dF/dn, forward, relative to 0.128", worst(forward / 0.128 - 1), 24 * p.epsilon)
    yield Check("dF/dn, reverse, relative to 0.128", worst(reverse / 0.128 - 1), 24 * p.epsilon)


def brewster(p: Precision) -> Iterator[Check]:
    theta = math.atan(1.5)
    value, forward, reverse = _reflectance_at(p, math.degrees(theta), 1.5)
    # R_s = sin(i - t)^2, as i + t is a right angle; F is the mean of R_s and R_p
    r_s = math.cos(2 * theta) ** 2
    yield Check("parallel reflectance, 2 F - R_s", worst(2 * value - r_s), 8 * p.epsilon * r_s)
    _, by_n = textbook(np.array(theta), 1.5)
    for mode, slope in (("forward", forward), ("reverse", reverse)):
        yield Check(f"dF/dn, {mode}, relative", worst(slope / float(by_n) - 1), 24 * p.epsilon)


# 11: the critical angle


def critical(p: Precision) -> Iterator[Check]:
    beyond = dr.cos(numbers_of(p, np.radians([41.82, 45, 60, 80, 89.9])))
    value, forward, reverse = slopes(lambda n: reflectance(beyond, n), dr.full(p.real, 1 / 1.5, 5))
    yield Check("beyond: F other than 1", count(value != 1), 0)
    yield Check("beyond: dF/dn other than 0", count((forward != 0) | (reverse != 0)), 0)
    around = np.concatenate([-np.logspace(-16, -1, 61), [0], np.logspace(-16, -1, 61)])
    found = slopes(*_near_critical(p, around))
    yield Check("around: NaN or infinite", count(~np.isfinite(found)), 0)
    # The relative error grows like ulp over the distance to the critical angle
    inside = np.logspace(math.log10(64 * p.epsilon), -1.5, 40)
    for mode, error in zip(("forward", "reverse"), _slope_errors(p, inside), strict=True):
        what = f"just inside: dF/dn, {mode}, relative error times the distance"
        yield Check(what, worst(error * inside), 4 * p.epsilon)


def _near_critical(p: Precision, inside: np.ndarray) -> tuple[Callable[[Array], Array], Array]:
    """Reflectance as a function of the index, and the index.

    Args:
        inside: by how many radians the angles are below the critical one.
    """
    cosine = numbers_of(p, np.cos(CRITICAL - inside))
    return lambda n: reflectance(cosine, n), dr.full(p.real, 1 / 1.5, len(inside))


def _slope_errors(p: Precision, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors of the derivative by the index, in forward and in reverse mode."""
    expected = _slopes_just_inside(inside)
    _, forward, reverse = slopes(*_near_critical(p, inside))
    return forward / expected - 1, reverse / expected - 1


def _slopes_just_inside(inside: np.ndarray) -> np.ndarray:
    return textbook(CRITICAL - inside.astype(np.longdouble), 1 / 1.5)[1].astype(np.float64)


def critical_chart() -> Chart:
    inside = np.logspace(-14, -1, 53)
    expected = _slopes_just_inside(inside)
    curves = []
    for p in PRECISIONS:
        _, by_reverse = _slope_errors(p, inside)
        curves.append(Curve(f"automatic differentiation, {p.name}", inside, abs(by_reverse)))
    for step in (1e-4, 1e-7):
        lower, upper = (
            np.array([_fresnel(math.cos(CRITICAL - x), 1 / 1.5 + h) for x in inside])
            for h in (-step, step)
        )
        error = abs((upper - lower) / (2 * step) / expected - 1)
        curves.append(Curve(f"differences, step {step:g}, double", inside, error))
    return Chart(
        "Fresnel reflectance just inside the critical angle, where its slope is infinite",
        "distance from the critical angle (radians)",
        "relative error of dF/dn (1 is 100 %)",
        tuple(curves),
        1e-2,
    )


def _fresnel(cosine: float, n: float) -> float:
    """Reflectance by the textbook's formula, in Python's floats."""
    squared = 1 - (1 - cosine * cosine) / n**2
    if squared <= 0:
        return 1.0
    t = math.sqrt(squared)
    r_s, r_p = (cosine - n * t) / (cosine + n * t), (n * cosine - t) / (n * cosine + t)
    return (r_s**2 + r_p**2) / 2


CASES = (
    Case(
        8,
        "index one",
        "F = 0 and dF/dn = 0 at every angle, never NaN; the image is that without the sphere",
        "Zeros are exact, by the order of the sums. A ray that passes through starts again at two "
        "rounded points. The slopes of the wall's colours are at most 1, so they are off by about "
        "4 roundings of numbers up to 5.",
        index_one,
    ),
    Case(
        9,
        "normal incidence",
        "F = ((n - 1) / (n + 1))^2 = 0.04 and dF/dn = 4 (n - 1) / (n + 1)^3 = 0.128 at n = 1.5",
        "1 / n is rounded by up to 1 ulp(1), which is 3 ulp of 1 - 1 / n = 1 / 3. The square "
        "doubles that, and other roundings add as much: 12 ulp. The derivative has twice that.",
        normal_incidence,
    ),
    Case(
        10,
        "Brewster angle",
        "at atan(1.5) = 56.3099 deg the parallel reflectance is 0",
        "The parallel amplitude is a rounding error, its square negligible. The perpendicular one "
        "is off by about 3 ulp, its square by up to 8.",
        brewster,
    ),
    Case(
        11,
        "critical angle",
        "F = 1 beyond asin(1 / 1.5) = 41.8103 deg; just inside its slope is infinite, and the "
        "computed slope finite",
        "At x radians inside, cos_t^2 = 2 tan(critical) x is a difference of numbers near 1, off "
        "by about 2 ulp. The slope goes like 1 / cos_t, so its relative error is up to 2 ulp / x. "
        "The rounded cosine of the angle adds as much.",
        critical,
        critical_chart,
        "at 1e-5 radians inside the critical angle the slope has two digits, below 1e-6 none",
    ),
)
