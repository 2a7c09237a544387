"""Hard cases of chains of rays: 14 to 20."""

import decimal
import functools
import math
from collections.abc import Iterator, Sequence
from decimal import Decimal

import drjit as dr
import numpy as np

from ..core.arrays import PRECISIONS, Array, Precision
from ..core.ray import NONE, Ray
from ..scene.scene import Scene
from ..tracing.intersect import closest_hit
from ..tracing.node import scatter
from ..tracing.optics import reflect
from ..tracing.surface import Surface, surface
from .case import Case, Chart, Check, Curve, count, rays_of, rounded, slopes, vectors_of, worst
from .scenes import (
    GLASS,
    GLOW,
    SKY,
    WHITE,
    ball,
    camera,
    material,
    picture,
    scene_of,
    slope_checks,
    wall,
)

CLEAR = material("clear", refraction=1, ior=1.5)
PIXEL = camera((0, 0, 5), (0, 0, 0), 1, (1, 1))


def follow(scene: Scene, ray: Ray, kinds: str) -> tuple[Ray, list[Surface]]:
    """Follow rays from surface to surface, where each is reflected ('r') or refracted ('t'): the
    last ray, and the surfaces.
    """
    seen = []
    for kind in kinds:
        at = surface(scene, ray, closest_hit(scene, ray))
        branch = scatter(scene, ray, at)[-1 if kind == "t" else 0]
        ray = Ray(at.p, branch.direction, at.hit.index, branch.inward)
        seen.append(at)
    return ray, seen


def _down(p: Precision, height: Array) -> Ray:
    """Rays towards -z at these distances from the axis."""
    rays = rays_of(p, np.zeros((3, dr.width(height))), np.array([[0.0], [0.0], [-1.0]]))
    return Ray(type(rays.o)(height, 0, 5), rays.d, rays.source, rays.inward)


# 14: ball lens

HEIGHTS = np.logspace(-3, -0.2, 15)


def _focus(p: Precision, heights: np.ndarray, n: Array) -> Array:
    """Where rays at these heights that pass a glass ball of radius 1 cross its axis, measured from
    its centre.
    """
    scene = scene_of(p, PIXEL, CLEAR, ball("ball", (0, 0, 0), 1, "clear")).carrying(
        {"materials.clear.ior": n}
    )
    ray, _ = follow(scene, _down(p, p.real(heights.astype(p.dtype))), "tt")
    return -(ray.o.z - ray.o.x * ray.d.z / ray.d.x)


def ball_lens(p: Precision) -> Iterator[Check]:
    heights = rounded(p, HEIGHTS)
    for n in (1.5, 2.0):
        turn = 2 * (np.arcsin(heights) - np.arcsin(heights / n))
        expected = heights / np.sin(turn)
        # d turn / d n = 2 tan(tt) / n, and the focus is h / sin(turn)
        by_n = -expected / np.tan(turn) * 2 * heights / n**2 / np.sqrt(1 - (heights / n) ** 2)
        value, forward, reverse = slopes(
            lambda n: _focus(p, HEIGHTS, n), dr.full(p.real, n, heights.size)
        )
        growth = p.epsilon / heights
        yield Check(
            f"focus for n = {n}, relative, times the height",
            worst((value / expected - 1) / growth) * p.epsilon,
            8 * p.epsilon,
        )
        for mode, slope in (("forward", forward), ("reverse", reverse)):
            yield Check(
                f"its derivative, {mode}, likewise",
                worst((slope / by_n - 1) / growth) * p.epsilon,
                16 * p.epsilon,
            )
        paraxial = n / (2 * (n - 1))
        # Spherical aberration: the rest is of second order in the height, with factors below 1
        rest = abs(value - paraxial) / (heights**2 + 8 * growth)
        yield Check(f"focus from n D / 4 (n - 1) = {paraxial:g}, over height^2", worst(rest), 1)


def ball_lens_chart() -> Chart:
    heights, curves = np.logspace(-6, -0.1, 30), []
    for p in PRECISIONS:
        h = rounded(p, heights)
        expected = h / np.sin(2 * (np.arcsin(h) - np.arcsin(h / 1.5)))
        error = abs(_focus(p, heights, dr.full(p.real, 1.5, heights.size)).numpy() / expected - 1)
        curves.append(Curve(f"traced, {p.name}", heights, error))
    curves.append(Curve("paraxial formula, double", heights, abs(1.5 / expected - 1)))
    return Chart(
        "Focus of a ball lens",
        "height of the ray over the axis, in radii",
        "relative error",
        tuple(curves),
        1e-2,
    )


# 15: furnace

REFLECTANCE = 0.05023991101223595  # at 45 degrees, n = 1.5


def furnace(p: Precision) -> Iterator[Check]:
    side = camera((math.sqrt(0.5), 0, 5), (math.sqrt(0.5), 0, 0), 1, (1, 1))
    scene = scene_of(p, SKY, side, GLASS, ball("ball", (0, 0, 0), 1, "glass"))
    for depth in (2, 3, 5, 9):
        expected = 1 - (1 - REFLECTANCE) * REFLECTANCE ** (depth - 2)
        value = picture(scene, max_depth=depth)
        yield Check(f"glass at 45 degrees, depth {depth}", worst(value - expected), 8 * p.epsilon)


def furnace_chart() -> Chart:
    depths, curves = np.arange(2, 13), []
    side = camera((math.sqrt(0.5), 0, 5), (math.sqrt(0.5), 0, 0), 1, (1, 1))
    for p in PRECISIONS:
        glass = scene_of(p, SKY, side, GLASS, ball("ball", (0, 0, 0), 1, "glass"))
        mirror = material("mirror", reflection=0.5, color=[0.5, 0.5, 0.5])
        hall = scene_of(
            p,
            GLOW,
            PIXEL,
            mirror,
            wall("one", (0, 0, 1), 1, "mirror"),
            wall("two", (0, 0, -1), 6, "mirror"),
        )
        for label, scene in (("glass", glass), ("mirrors, half of it reflected", hall)):
            lost = [abs(1 - picture(scene, max_depth=depth)[0, 0, 0]) for depth in depths.tolist()]
            curves.append(Curve(f"{label}, {p.name}", depths, np.array(lost)))
    return Chart(
        "What is lost beyond the largest depth, where all is 1",
        "max_depth",
        "missing radiance",
        tuple(curves),
        1e-2,
        linear=True,
    )


# 16: mirrors


def mirror_sphere(p: Precision) -> Iterator[Check]:
    rng = np.random.default_rng(16)
    d, n = rng.normal(size=(2, 3, 2000))
    d, n = (rounded(p, v / np.linalg.norm(v, axis=0)) for v in (d, n))
    out = reflect(vectors_of(p, d), vectors_of(p, n)).numpy().astype(np.float64)
    yield Check("d - 2 (d . n) n", worst(out - (d - 2 * (d * n).sum(0) * n)), 4 * p.epsilon)
    scene = scene_of(
        p,
        GLOW,
        PIXEL,
        material("m", color=[0.5, 0.5, 0.5], reflection=0.5),
        ball("ball", (0, 0, 5), 2, "m"),
    )
    ray = rays_of(p, np.array([[0.0], [0.0], [5.0]]), d)
    for bounces in (1, 2, 6):
        last, _ = follow(scene, ray, "r" * bounces)
        returned = last.d.numpy().astype(np.float64) - (-1) ** bounces * d
        # Each bounce turns the ray by twice the error of its normal, and the next is as far off
        # again
        yield Check(
            f"from the centre, {bounces} bounces: direction",
            worst(returned),
            6 * 3**bounces * p.epsilon,
        )
    image = picture(scene, max_depth=6)
    yield Check(
        "camera at the centre: series of 0.5^k",
        worst(image - sum(0.5**k / 2 for k in range(6))),
        4 * p.epsilon,
    )


# 17: facing mirrors and a corner


def mirrors(p: Precision) -> Iterator[Check]:
    parts = (
        PIXEL,
        material("m", color=[1, 1, 1], reflection=0.75),
        wall("one", (0, 0, 1), 1, "m"),
        wall("two", (0, 0, -1), 6, "m"),
    )
    scene = scene_of(p, GLOW, *parts)
    for depth in (1, 2, 7, 20):
        error = picture(scene, max_depth=depth) / ((1 - 0.75**depth) / 0.25) - 1
        yield Check(
            f"facing mirrors, {depth} nodes: sum of reflection^k",
            worst(error),
            2 * depth * p.epsilon,
        )
    walls = (wall(f"w{k}", np.eye(3, dtype=int)[k].tolist(), 0, "m") for k in range(3))
    corner = scene_of(p, PIXEL, material("m", reflection=1), *walls)
    d = np.random.default_rng(17).uniform(-1, -0.2, (3, 500))
    d = rounded(p, d / np.linalg.norm(d, axis=0))
    ray, _ = follow(corner, rays_of(p, np.array([[3.0], [5.0], [4.0]]), d), "rrr")
    yield Check(
        "corner: rays that do not leave after three bounces",
        count(closest_hit(corner, ray).index.numpy() != NONE),
        0,
    )
    yield Check("corner: out + in", worst(ray.d.numpy() + d), 4 * p.epsilon)


# 18: many mirrors

BOUNCES = 14
START = Decimal("0.1")
# How many bounces a precision is good for: ten times the error at each
GOOD = {"single": 4, "double": 10}


def _discs() -> list[tuple[int, int]]:
    return [(x, y) for x in range(-2, 4) for y in range(-2, 4)]


def _photon(y: Decimal) -> list[tuple[Decimal, list[Decimal], list[Decimal]]]:
    """The photon of the hundred-digit challenge, problem 2, exactly: time, place and new direction
    of each bounce.
    """
    time, p, d, bounces = Decimal(0), [Decimal("0.5"), y], [Decimal(1), Decimal(0)], []
    for _ in range(BOUNCES):
        distances = []
        for center in _discs():
            to = [c - x for c, x in zip(center, p, strict=True)]
            b = to[0] * d[0] + to[1] * d[1]
            squared = Decimal(1) / 9 - to[0] ** 2 - to[1] ** 2 + b * b
            # The disc that it has just left has a root at 0
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
def _exactly() -> tuple[np.ndarray, np.ndarray, float]:
    """Abscissas of the bounces, their derivatives by the start's ordinate, and the distance from
    the origin at time 10.
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
    """Abscissas of the bounces, and their derivatives by the start's ordinate, forward and reverse."""
    discs = "".join(ball(f"d{k}", (x, y, 0), 1 / 3, "m") for k, (x, y) in enumerate(_discs()))
    scene = scene_of(p, PIXEL, material("m", reflection=1), discs)
    ray = rays_of(p, [0.5, p.dtype(START), 0], [1, 0, 0])
    tangent, rays, x, forward = (p.vector(0, 1, 0), p.vector(0)), [], [], []
    for _ in range(BOUNCES):
        rays.append(ray)
        dr.enable_grad(ray.o, ray.d)
        dr.set_grad(ray.o, tangent[0])
        dr.set_grad(ray.d, tangent[1])
        after, _ = follow(scene, ray, "r")
        # The new direction depends on the new origin, whose tangent would be cleared on the way
        tangent = dr.forward_to(after.o, after.d, flags=dr.ADFlag.ClearNone)
        ray = dr.detach(after)
        dr.eval(ray, tangent)
        x.append(ray.o.x[0])
        forward.append(tangent[0].x[0])
    return (
        np.array(x),
        np.array(forward),
        np.array([_reverse(scene, rays[:k], p) for k in range(1, BOUNCES + 1)]),
    )


def _reverse(scene: Scene, rays: Sequence[Ray], p: Precision) -> float:
    """The derivative of the last ray's next abscissa by the first one's ordinate."""
    adjoint = p.vector(1, 0, 0), p.vector(0)
    for ray in reversed(rays):
        start = dr.detach(ray)
        dr.enable_grad(start.o, start.d)
        after, _ = follow(scene, start, "r")
        dr.backward(dr.dot(after.o, adjoint[0]) + dr.dot(after.d, adjoint[1]))
        adjoint = dr.grad(start.o), dr.grad(start.d)
        dr.eval(adjoint)
    return adjoint[0].y[0]


def many_mirrors(p: Precision) -> Iterator[Check]:
    x, by_start, distance = _exactly()
    yield Check(
        "distance at time 10 from 0.9952629194, in 80 digits", abs(distance - 0.9952629194), 5e-11
    )
    traced, forward, reverse = _traced(p)
    good = GOOD[p.name]
    # A rounding at the start is magnified as the start's derivative is, and each bounce adds one,
    # magnified by what follows
    grown = p.epsilon * np.maximum.accumulate(np.abs(by_start)) * np.arange(1, BOUNCES + 1)
    yield Check(
        f"abscissas of {good} bounces, over their magnified roundings",
        worst((traced - x)[:good] / grown[:good]),
        4,
    )
    for mode, slope in (("forward", forward), ("reverse", reverse)):
        error = (slope / by_start - 1)[:good] / grown[:good]
        yield Check(f"their derivatives, {mode}, relative, likewise", worst(error), 40)
    yield Check(f"error at bounce {good}", abs(traced - x)[good - 1], 1e-2)


def many_mirrors_chart() -> Chart:
    x, by_start, _ = _exactly()
    bounces, curves = np.arange(1, BOUNCES + 1), []
    for p in PRECISIONS:
        traced, forward, _ = _traced(p)
        curves.append(Curve(f"place, {p.name}", bounces, abs(traced - x)))
        curves.append(
            Curve(f"its derivative, relative, {p.name}", bounces, abs(forward / by_start - 1))
        )
    return Chart(
        "A photon among mirrors of radius 1/3", "bounce", "error", tuple(curves), 1e-2, linear=True
    )


# 19: a ball in glass


def ball_in_glass(p: Precision) -> Iterator[Check]:
    inner, n = 0.4, 1.5
    text = (
        CLEAR,
        WHITE,
        ball("glass", (0, 0, 0), 1, "clear"),
        ball("inside", (0, 0, 0), inner, "white"),
    )
    offset = np.concatenate([-np.logspace(-15, -1, 57), np.logspace(-15, -1, 57)])
    height = rounded(p, n * inner * (1 + offset))
    ray, _ = follow(scene_of(p, PIXEL, *text), _down(p, p.real(height.astype(p.dtype))), "t")
    seen = closest_hit(scene_of(p, PIXEL, *text), ray).index.numpy() == 1
    clear = abs(height / (n * rounded(p, inner)) - 1) > 20 * p.epsilon
    yield Check(
        "rays on the wrong side of the apparent radius n b",
        count((seen != (height < n * rounded(p, inner))) & clear),
        0,
    )
    # What a camera sees of it, a disc of pi f^2 h^2 / (D^2 - h^2) pixels with h = n b, and how that
    # grows with the index
    side, away, fov = 64, 4.0, 25.0
    scene = scene_of(p, GLOW, camera((0, 0, away), (0, 0, 0), fov, (side, side)), *text)
    f2, h = (side / 2 / math.tan(math.radians(fov) / 2)) ** 2, n * inner
    area, slope = (
        math.pi * f2 * h**2 / (away**2 - h**2),
        2 * math.pi * f2 * h * away**2 / (away**2 - h**2) ** 2,
    )
    yield Check("area seen", abs(picture(scene, 4, boundary=True).sum() / 3 / area - 1), 1e-3)
    yield from slope_checks(
        scene, "materials.clear.ior", None, slope * inner, 1e-2, 4, boundary=True
    )
    yield from slope_checks(scene, "spheres.inside.radius", None, slope * n, 1e-2, 4, boundary=True)


# 20: shell, bubble, equal indices


def shells(p: Precision) -> Iterator[Check]:
    air = material("air", refraction=1, ior=1)
    scene = scene_of(
        p,
        PIXEL,
        CLEAR,
        air,
        ball("glass", (0, 0, 0), 1, "clear"),
        ball("bubble", (0, 0, 0), 0.5, "air"),
    )
    height = np.linspace(0.01, 0.45, 45)
    rays = _down(p, p.real(height.astype(p.dtype)))
    within, _ = follow(scene, rays, "tt")
    # Snell twice: n r sin is the same on every shell, so that in the air within, the ray passes the
    # centre as it set out
    passes = dr.norm(dr.cross(within.o, within.d)).numpy()
    yield Check(
        "distance from the centre in a bubble", worst(passes - rounded(p, height)), 16 * p.epsilon
    )
    out, _ = follow(scene, rays, "tttt")
    turn = 2 * (
        np.arcsin(height)
        - np.arcsin(height / 1.5)
        + np.arcsin(height / 0.75)
        - np.arcsin(height / 0.5)
    )
    yield Check(
        "turn by shell and bubble",
        worst(np.arctan2(out.d.x.numpy(), -out.d.z.numpy()) + turn),
        64 * p.epsilon,
    )
    back = (
        CLEAR,
        WHITE,
        wall("back", (0.2, 0, 1), 1.5, "white"),
        ball("glass", (0, 0, 0), 1, "clear"),
    )
    room = (
        SKY,
        "ambient = [0.2, 0.2, 0.2]\n",
        "max_depth = 7\n",
        camera((0.1, 0.2, 4), (0, 0, 0), 40, (24, 24)),
        *back,
    )
    lamp = "[[lights]]\nposition = [3, 3, 4]\nintensity = [1, 1, 1]\n"
    with_ball = picture(scene_of(p, *room, ball("inside", (0.2, 0, 0.1), 0.5, "clear"), lamp))
    error = np.sort(abs(with_ball - picture(scene_of(p, *room, lamp))).max(-1).ravel())
    # Glass magnifies a rounding by its 1 / cos at the rim; samples whose shadow's edge lies within
    # it may flip
    yield Check(
        "equal index within glass: image minus the one without, 99 % of its pixels",
        error[int(0.99 * error.size)],
        100 * p.epsilon,
    )


CASES = (
    Case(
        14,
        "ball lens",
        "focus at n D / 4 (n - 1) from the centre: 1.5 for n = 1.5, D = 2, and the rear surface for n = 2",
        "The crossing is a height over a slope, both of size h and off by some ulp(1), so by ulp / h relatively; aberration is "
        "below h^2.",
        ball_lens,
        ball_lens_chart,
        "rays within 1e-5 radii of the axis lose all but two digits",
    ),
    Case(
        15,
        "furnace",
        "where everything radiates 1, glass shows 1 - (1 - R) R^N after N inner nodes; R = 0.050240 at 45 deg",
        "Weights are products of a few factors below 1, each rounded.",
        furnace,
        furnace_chart,
    ),
    Case(
        16,
        "mirror sphere",
        "d - 2 (d . n) n; from the centre of a mirror the ray returns on itself",
        "Two products and sums of numbers up to 2 for the direction. A ray through the centre that is off by e meets the sphere "
        "e / r beside its axis, which turns it by 2 e / r more: three times the error at each bounce.",
        mirror_sphere,
    ),
    Case(
        17,
        "facing mirrors",
        "two mirrors pass on reflection^k, cut exactly at max_depth; a corner of three returns out = -in",
        "A product and a sum for each node; reflection at coordinate planes only changes signs.",
        mirrors,
    ),
    Case(
        18,
        "many mirrors",
        "the photon of the hundred-digit challenge, problem 2: error grows tenfold a bounce",
        "Roundings are magnified as the derivative by the start, which is known in 80 digits; the derivative's own error is "
        "magnified "
        "by curvatures 2 / (r cos) of up to 10 as well.",
        many_mirrors,
        many_mirrors_chart,
        "good for 4 bounces between curved mirrors, where double is for 10",
    ),
    Case(
        19,
        "ball in glass",
        "an opaque ball of radius b within glass has the apparent radius n b; its area and d area / d n in closed form",
        "Two square roots and a refraction round the ray by 20 ulp. Edges through glass are chords between samples, "
        "whose error is of second order in their spacing of 1/30 of the radius.",
        ball_in_glass,
    ),
    Case(
        20,
        "shells and bubbles",
        "media bend by their relative index; a ball of equal index within glass is invisible",
        "n r sin is kept by each of two refractions, off by 4 ulp each time; in turns these are magnified by 1 / cos of up to "
        "2.3, "
        "four times.",
        shells,
    ),
)
