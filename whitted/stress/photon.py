"""Hard case 18: a photon among many mirrors.

Source: problem 2 of the hundred-dollar, hundred-digit challenge (L. N. Trefethen, SIAM News, 2002).
A photon leaves (0.5, 0.1) along x at unit speed, among circular mirrors of radius 1/3 around all
points of integer coordinates. How far from the origin is it at time 10?
"""

import decimal
import functools
from collections.abc import Iterator, Sequence
from decimal import Decimal

import drjit as dr
import numpy as np

from ..core.arrays import PRECISIONS, Precision
from ..core.ray import Ray
from ..scene.scene import Scene
from .arrays import rays_of, worst
from .case import Case, Chart, Check, Curve
from .chains import as_kernels_see, follow
from .scenes import PIXEL, ball, material, scene_of

BOUNCES = 14
START = Decimal("0.1")
# Bounces after which the position is still good to 1e-2: each bounce makes the error ten times
# larger
GOOD_BOUNCES = {"single": 4, "double": 10}


def _centers() -> list[tuple[int, int]]:
    """The centres of all mirrors that the photon can meet in so many bounces."""
    return [(x, y) for x in range(-2, 4) for y in range(-2, 4)]


def _photon(y: Decimal) -> list[tuple[Decimal, list[Decimal], list[Decimal]]]:
    """The time, the place and the new direction of each bounce, in `decimal`'s precision.

    Args:
        y: where the photon starts.
    """
    time, p, d, bounces = Decimal(0), [Decimal("0.5"), y], [Decimal(1), Decimal(0)], []
    for _ in range(BOUNCES):
        distances = []
        for center in _centers():
            to = [c - x for c, x in zip(center, p, strict=True)]
            b = to[0] * d[0] + to[1] * d[1]
            squared = Decimal(1) / 9 - to[0] ** 2 - to[1] ** 2 + b * b
            # The mirror that the photon has just left has a root at 0
            if squared > 0 and b - squared.sqrt() > Decimal("1e-30"):
                distances.append((b - squared.sqrt(), center))
        t, center = min(distances)
        time, p = time + t, [x + t * v for x, v in zip(p, d, strict=True)]
        n = [3 * (x - c) for x, c in zip(p, center, strict=True)]
        along = 2 * (d[0] * n[0] + d[1] * n[1])
        d = [v - along * m for v, m in zip(d, n, strict=True)]
        bounces.append((time, p, d))
    return bounces


@functools.cache
def _exact() -> tuple[np.ndarray, np.ndarray, float]:
    """The path in 80 digits.

    Returns:
        x of each bounce; its derivative by y of the start; the distance from the origin at time 10.
    """
    with decimal.localcontext(prec=80):
        step = Decimal("1e-40")
        bounces, lower, upper = (_photon(START + sign * step) for sign in (0, -1, 1))
        x = [place[0] for _, place, _ in bounces]
        slope = [(b[1][0] - a[1][0]) / (2 * step) for a, b in zip(lower, upper, strict=True)]
        time, place, d = [bounce for bounce in bounces if bounce[0] < 10][-1]
        end = [a + (10 - time) * v for a, v in zip(place, d, strict=True)]
        return np.array(x, float), np.array(slope, float), float((end[0] ** 2 + end[1] ** 2).sqrt())


def _traced(p: Precision) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x of each bounce, and its derivatives by y of the start, in forward and in reverse mode."""
    mirrors = "".join(ball(f"d{k}", (x, y, 0), 1 / 3, "m") for k, (x, y) in enumerate(_centers()))
    scene = as_kernels_see(scene_of(p, PIXEL, material("m", reflection=1), mirrors))
    ray = rays_of(p, [0.5, p.dtype(START), 0], [1, 0, 0])
    tangent = p.vector(0, 1, 0), p.vector(0)
    rays, x, forward = [], [], []
    for _ in range(BOUNCES):
        rays.append(ray)
        dr.enable_grad(ray.o, ray.d)
        dr.set_grad(ray.o, tangent[0])
        dr.set_grad(ray.d, tangent[1])
        after = follow(scene, ray, "r")
        # The new direction depends on the new origin, whose tangent must not be cleared on the way
        tangent = dr.forward_to(after.o, after.d, flags=dr.ADFlag.ClearNone)
        ray = dr.detach(after)
        dr.eval(ray, tangent)
        x.append(ray.o.x[0])
        forward.append(tangent[0].x[0])
    reverse = [_reverse(scene, rays[:k], p) for k in range(1, BOUNCES + 1)]
    return np.array(x), np.array(forward), np.array(reverse)


def _reverse(scene: Scene, rays: Sequence[Ray], p: Precision) -> float:
    """The derivative of x where the last ray ends by y where the first one starts."""
    adjoint = p.vector(1, 0, 0), p.vector(0)
    for ray in reversed(rays):
        start = dr.detach(ray)
        dr.enable_grad(start.o, start.d)
        after = follow(scene, start, "r")
        dr.backward(dr.dot(after.o, adjoint[0]) + dr.dot(after.d, adjoint[1]))
        adjoint = dr.grad(start.o), dr.grad(start.d)
        dr.eval(adjoint)
    return adjoint[0].y[0]


def many_mirrors(p: Precision) -> Iterator[Check]:
    x, by_start, distance = _exact()
    error = abs(distance - 0.9952629194)
    yield Check("distance at time 10 from 0.9952629194, in 80 digits", error, 5e-11)
    traced, forward, reverse = _traced(p)
    good = GOOD_BOUNCES[p.name]
    # A rounding at the start is magnified by the derivative by the start. Each bounce adds another
    # rounding, which the later bounces magnify.
    grown = p.epsilon * np.maximum.accumulate(np.abs(by_start)) * np.arange(1, BOUNCES + 1)
    error = worst((traced - x)[:good] / grown[:good])
    yield Check(f"x of {good} bounces, over the magnified roundings", error, 4)
    for mode, slope in (("forward", forward), ("reverse", reverse)):
        error = worst((slope / by_start - 1)[:good] / grown[:good])
        yield Check(f"derivatives of x, {mode}, relative, over the same", error, 40)
    yield Check(f"x of bounce {good}", abs(traced - x)[good - 1], 1e-2)


def many_mirrors_chart() -> Chart:
    x, by_start, _ = _exact()
    bounces, curves = np.arange(1, BOUNCES + 1), []
    for p in PRECISIONS:
        traced, forward, _ = _traced(p)
        curves.append(Curve(f"x, {p.name}", bounces, abs(traced - x)))
        error = abs(forward / by_start - 1)
        curves.append(Curve(f"its derivative, relative, {p.name}", bounces, error))
    title = "Photon among mirrors of radius 1/3"
    errors = "error of x (scene units), and\nof its derivative (1 is 100 %)"
    return Chart(title, "number of bounces", errors, tuple(curves), 1e-2, linear=True)


CASES = (
    Case(
        18,
        "many mirrors",
        "the photon of the hundred-digit challenge, problem 2: its error grows tenfold per bounce",
        "Roundings are magnified by the derivative by the start, which is known in 80 digits. The "
        "error of the derivative is also magnified by curvatures 2 / (r cos), of up to 10.",
        many_mirrors,
        many_mirrors_chart,
        "good for 4 bounces between curved mirrors, where double precision is good for 10",
    ),
)
