"""Hard cases of ray-sphere intersection: 1 and 2, with the textbook quadratic beside ours."""

from collections.abc import Iterator

import drjit as dr
import numpy as np

from ..core.arrays import PRECISIONS, Array, Precision
from ..core.ray import Ray, ShadowRay
from ..shapes import Sphere
from .arrays import count, rays_of, rounded, vectors_of, worst
from .case import Case, Chart, Check, Curve
from .scenes import (
    WHITE,
    WHITE_AMBIENT,
    ball,
    camera,
    finite_checks,
    lamp,
    picture,
    scene_of,
    slope_checks,
    total,
    white_ball,
)


def textbook_distance(sphere: Sphere, o: Array, d: Array) -> Array:
    """The near root of t^2 + 2 b t + c = 0 as textbooks compute it.

    c = |o - center|^2 - r^2 is a difference of nearly equal numbers far from the sphere.
    """
    from_center = o - sphere.center
    b, c = dr.dot(from_center, d), dr.squared_norm(from_center) - sphere.radius * sphere.radius
    return -b - dr.sqrt(b * b - c)


def intersect(
    sphere: Sphere,
    p: Precision,
    o: np.ndarray,
    d: np.ndarray,
    on: bool = False,
    inward: bool = False,
) -> tuple[np.ndarray, np.ndarray, Ray]:
    """Intersect rays with a sphere.

    Args:
        o: origins, of shape (3, N) or (3, 1).
        d: unit directions, likewise.
        on: the rays start on the sphere.
        inward: the rays leave into the sphere.

    Returns:
        The distances, whether the sphere is hit, and the rays.
    """
    ray = rays_of(p, o, d, inward)
    t, hit, _ = sphere.distance(ray, dr.full(dr.mask_t(p.real), on, dr.width(ray.o)))
    return t.numpy().astype(np.float64), hit.numpy(), ray


def sphere_at(p: Precision, center: tuple = (0.0, 0.0, 0.0), radius: float = 1.0) -> Sphere:
    """A sphere for `intersect`, of unit radius at the origin unless told otherwise."""
    return Sphere("sphere", "", p.vector(*center), p.real(radius))


# 1: rays at a sphere's rim

OFFSETS = np.array([-1e-3, -1e-5, -1e-7, -1e-9, 0, 1e-9, 1e-7, 1e-5, 1e-3])


def _rim_rays(offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays in all directions of the xy plane that pass the origin at a distance of 1 + offset.

    Returns:
        The offset of each ray; the origins, 3 before the point nearest to the origin; directions.
    """
    angle, offset = (
        grid.ravel() for grid in np.meshgrid(np.radians(np.arange(0, 360, 7)), offsets)
    )
    d = np.stack([np.cos(angle), np.sin(angle), 0 * angle])
    side = np.stack([-np.sin(angle), np.cos(angle), 0 * angle])
    return offset, side * (1 + offset) - 3 * d, d


def tangent(p: Precision) -> Iterator[Check]:
    offset, o, d = _rim_rays(OFFSETS)
    t, hit, ray = intersect(sphere_at(p), p, o, d)
    on = dr.full(dr.mask_t(p.real), False, len(offset))
    length = dr.full(p.real, 6, len(offset))
    segment = ShadowRay(ray.o, ray.d, length, ray.o + 6 * ray.d, ray.source, on)
    blocked = sphere_at(p).blocks(segment, on).numpy()
    yield Check("rays on which search and shadow test disagree", count(hit != blocked), 0)
    clear = abs(offset) > 10 * p.epsilon
    wrong = (hit != (offset < 0)) & clear
    yield Check("wrong answers, more than 10 ulp from the rim", count(wrong), 0)
    exact = 3 - np.sqrt(np.maximum(-offset * (2 + offset), 0))
    yield Check("distance of hits", worst((t - exact)[hit]), np.sqrt(20 * p.epsilon))
    view = camera((1, 0, 5), (1, 0, 0), 1, (1, 1))
    unit = ball("ball", (0, 0, 0), 1, "white")
    scene = scene_of(p, WHITE_AMBIENT, view, WHITE, unit, lamp((1, 2, 5)))
    yield from finite_checks(scene, "a pixel on the rim", "spheres.ball.radius")


def tangent_chart() -> Chart:
    depth = np.logspace(-12, -1, 45)
    curves = []
    for p in PRECISIONS:
        o = np.stack([1 - depth, 0 * depth, 0 * depth + 30])
        d = np.stack([0 * depth, 0 * depth, 0 * depth - 1])
        x = 1 - depth.astype(np.longdouble)
        exact = (30 - np.sqrt(1 - x * x)).astype(np.float64)
        t, hit, ray = intersect(sphere_at(p), p, o, d)
        textbook = textbook_distance(sphere_at(p), ray.o, ray.d).numpy()
        curves.append(Curve(f"ours, {p.name}", depth, abs(np.where(hit, t, np.nan) - exact)))
        curves.append(Curve(f"textbook quadratic, {p.name}", depth, abs(textbook - exact)))
    return Chart(
        "Ray that grazes a unit sphere",
        "depth of the ray below the rim (radii)",
        "error of the distance (radii)",
        tuple(curves),
        1e-2,
    )


# 2: distant spheres

DISTANCES = (1e2, 1e3, 1e4)


def distant(p: Precision) -> Iterator[Check]:
    yield from _distant_hits(p)
    for distance in DISTANCES:
        # A field of view that is 1.3 times as wide as the sphere
        fov = float(np.degrees(2 * np.arctan(1.3 / distance)))
        scene, expected = white_ball(p, distance, 1.0, 64, fov)
        area = total(picture(scene, 4, boundary=True))
        yield Check(f"area at {distance:g}, relative", abs(area / expected.area - 1), 1e-3)
        yield from slope_checks(
            scene, "spheres.ball.radius", None, expected.by_radius, 1e-3, 4, boundary=True
        )


def _distant_hits(p: Precision) -> Iterator[Check]:
    """A grid of parallel rays over the sphere: cancellation would show as rings of wrong hits."""
    side = 1000
    at = (np.arange(side) + 0.5) / side * 2.2 - 1.1
    x, y = (rounded(p, grid.ravel()) for grid in np.meshgrid(at, at))
    squared = x * x + y * y
    for distance in DISTANCES:
        sphere = sphere_at(p, (0.0, 0.0, -distance))
        t, hit, _ = intersect(sphere, p, np.stack([x, y, 0 * x]), np.stack([0, 0, -1]))
        clear = abs(squared - 1) > 10 * p.epsilon
        wrong = (hit != (squared < 1)) & clear
        yield Check(f"at {distance:g}: wrong answers", count(wrong), 0)
        middle = squared < 0.5
        error = t - distance + np.sqrt(np.maximum(1 - squared, 0))
        yield Check(f"at {distance:g}: distance", worst(error[middle]), 2 * p.epsilon * distance)


def distant_chart() -> Chart:
    distance = np.logspace(0.5, 8, 31)
    curves = []
    for p in PRECISIONS:
        center = vectors_of(p, np.stack([0 * distance, 0 * distance, -distance]))
        sphere = Sphere("", "", center, p.real(1))
        far = rounded(p, distance)
        o = np.stack([0.6 + 0 * far, 0 * far, 0 * far])
        t, _, ray = intersect(sphere, p, o, np.stack([0, 0, -1]))
        textbook = textbook_distance(sphere, ray.o, ray.d).numpy()
        to_front = np.sqrt(1 - rounded(p, 0.6) ** 2)
        for label, value in (("ours", t), ("textbook quadratic", textbook)):
            curves.append(Curve(f"{label}, {p.name}", distance, abs(value - far + to_front)))
    title = "Unit sphere far away"
    return Chart(title, "distance (radii)", "error of the hit (radii)", tuple(curves), 0.1)


CASES = (
    Case(
        1,
        "tangent ray",
        "hit or miss, the same for search and shadow test; never NaN",
        "The discriminant is near 0, a difference of products near 10, so it is off by up to 20 "
        "ulp(1), and its root by sqrt(20 ulp).",
        tangent,
        tangent_chart,
        "at the rim the distance has only half of the digits, about 3",
    ),
    Case(
        2,
        "distant sphere",
        "silhouette pi f^2 r^2 / (d^2 - r^2) to 0.1 %, without rings",
        "The distance of the ray from the centre is computed before it is squared, so the "
        "discriminant is off by a few ulp(r^2), not ulp(d^2). The hit distance is rounded to "
        "ulp(d). Edges are chords, which costs far less than 0.1 % at 64 x 64 pixels, spp 4.",
        distant,
        distant_chart,
    ),
)
