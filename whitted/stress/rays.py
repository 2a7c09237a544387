"""Hard cases of single rays and spheres: 1, 2, 6 and 7, and the quadratic formula of textbooks to
compare with.
"""

from collections.abc import Iterator

import drjit as dr
import numpy as np

from ..core.arrays import PRECISIONS, Array, Precision
from ..core.ray import ShadowRay
from ..scene.camera import Camera
from ..shapes.sphere import Sphere
from ..tracing.primary import camera_frame, primary_ray
from .case import Case, Chart, Check, Curve, count, rays_of, rounded, vectors_of, worst
from .scenes import (
    GLOW,
    WHITE,
    ball,
    camera,
    finite_checks,
    forward,
    lamp,
    picture,
    reverse,
    scene_of,
    slope_checks,
)


def naive_distance(sphere: Sphere, o: Array, d: Array) -> Array:
    """The near root of t^2 + 2 b t + c = 0 as textbooks write it: c = |o - center|^2 - r^2 cancels
    far away.
    """
    from_center = o - sphere.center
    b, c = dr.dot(from_center, d), dr.squared_norm(from_center) - sphere.radius * sphere.radius
    return -b - dr.sqrt(b * b - c)


def met(
    sphere: Sphere,
    p: Precision,
    o: np.ndarray,
    d: np.ndarray,
    on: bool = False,
    inward: bool = False,
) -> tuple:
    """Distance, whether the sphere is met, and the rays, as arrays of NumPy and a `Ray`."""
    ray = rays_of(p, o, d, inward)
    t, hit, _ = sphere.distance(ray, dr.full(dr.mask_t(p.real), on, dr.width(ray.o)))
    return t.numpy().astype(np.float64), hit.numpy(), ray


def _ball(
    p: Precision, center: tuple = (0.0, 0.0, 0.0), radius: float = 1.0, wide: bool = False
) -> Sphere:
    return Sphere("ball", "", p.vector(*center), p.real(radius), wide)


# 1: tangent rays

OFFSETS = np.array([-1e-3, -1e-5, -1e-7, -1e-9, 0, 1e-9, 1e-7, 1e-5, 1e-3])


def _tangents(offset: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays in all directions of a plane which pass the unit sphere at 1 + offset: offsets, origins,
    directions.
    """
    angle, offset = (grid.ravel() for grid in np.meshgrid(np.radians(np.arange(0, 360, 7)), offset))
    d = np.stack([np.cos(angle), np.sin(angle), 0 * angle])
    return offset, np.stack([-np.sin(angle), np.cos(angle), 0 * angle]) * (1 + offset) - 3 * d, d


def tangent(p: Precision) -> Iterator[Check]:
    offset, o, d = _tangents(OFFSETS)
    t, hit, ray = met(_ball(p), p, o, d)
    no = dr.full(dr.mask_t(p.real), False, len(offset))
    segment = ShadowRay(
        ray.o, ray.d, dr.full(p.real, 6, len(offset)), ray.o + 6 * ray.d, ray.source, no
    )
    blocked = _ball(p).blocks(segment, no).numpy()
    yield Check(
        "rays that the search hits and the shadow test misses, or vice versa",
        count(hit != blocked),
        0,
    )
    clear = abs(offset) > 10 * p.epsilon
    yield Check(
        "wrong hits, farther from the rim than 10 ulp", count((hit != (offset < 0)) & clear), 0
    )
    exact = 3 - np.sqrt(np.maximum(-offset * (2 + offset), 0))
    yield Check("distance where it hits", worst((t - exact)[hit]), np.sqrt(20 * p.epsilon))
    scene = scene_of(
        p,
        GLOW,
        camera((1, 0, 5), (1, 0, 0), 1, (1, 1)),
        WHITE,
        ball("ball", (0, 0, 0), 1, "white"),
        lamp((1, 2, 5)),
    )
    yield from finite_checks(scene, "a pixel on the rim", "spheres.ball.radius")


def tangent_chart() -> Chart:
    depth = np.logspace(-12, -1, 45)
    curves = []
    for p in PRECISIONS:
        o = np.stack([1 - depth, 0 * depth, 0 * depth + 30])
        d = np.stack([0 * depth, 0 * depth, 0 * depth - 1])
        gone = 1 - depth.astype(np.longdouble)
        exact = (30 - np.sqrt(1 - gone * gone)).astype(np.float64)
        t, hit, ray = met(_ball(p), p, o, d)
        naive = naive_distance(_ball(p), ray.o, ray.d).numpy()
        for label, value in (("stable", np.where(hit, t, np.nan)), ("textbook quadratic", naive)):
            curves.append(Curve(f"{label}, {p.name}", depth, abs(value - exact)))
    return Chart(
        "A ray that only just touches a sphere",
        "depth of the ray below the rim",
        "error of the distance",
        tuple(curves),
        1e-2,
    )


# 2: distant spheres

DISTANCES = (1e2, 1e3, 1e4)


def distant(p: Precision) -> Iterator[Check]:
    side = 1000
    at = (np.arange(side) + 0.5) / side * 2.2 - 1.1
    x, y = (rounded(p, grid.ravel()) for grid in np.meshgrid(at, at))
    squared = x * x + y * y
    for distance in DISTANCES:
        t, hit, _ = met(
            _ball(p, (0.0, 0.0, -distance)), p, np.stack([x, y, 0 * x]), np.stack([0, 0, -1])
        )
        away = abs(squared - 1) > 10 * p.epsilon
        yield Check(
            f"rings at {distance:g}: samples on the wrong side",
            count((hit != (squared < 1)) & away),
            0,
        )
        middle = squared < 0.5
        yield Check(
            f"distance at {distance:g}",
            worst((t - distance + np.sqrt(np.maximum(1 - squared, 0)))[middle]),
            2 * p.epsilon * distance,
        )
    # The whole way from a camera, whose field of view just holds the sphere
    for distance in DISTANCES:
        scene, area, by_radius = disc(
            p, distance, 1.0, 64, float(np.degrees(2 * np.arctan(1.3 / distance)))
        )
        image = picture(scene, 4, boundary=True)
        yield Check(f"area at {distance:g}", abs(image.sum() / 3 / area - 1), 1e-3)
        yield from slope_checks(
            scene, "spheres.ball.radius", None, by_radius, 1e-3, 4, boundary=True
        )


def disc(p: Precision, distance: float, radius: float, side: int, fov: float) -> tuple:
    """A glowing sphere on the axis: the scene, the pixels that it covers, and their derivative by
    its radius.
    """
    scene = scene_of(
        p,
        GLOW,
        camera((0, 0, distance), (0, 0, 0), fov, (side, side)),
        WHITE,
        ball("ball", (0, 0, 0), radius, "white"),
    )
    f2, r2, d2 = (side / 2 / np.tan(np.radians(fov) / 2)) ** 2, radius**2, distance**2
    return scene, np.pi * f2 * r2 / (d2 - r2), 2 * np.pi * f2 * radius * d2 / (d2 - r2) ** 2


def distant_chart() -> Chart:
    distance = np.logspace(0.5, 8, 31)
    curves = []
    for p in PRECISIONS:
        sphere = Sphere(
            "",
            "",
            vectors_of(p, np.stack([0 * distance, 0 * distance, -distance])),
            p.real(1),
            False,
        )
        far = rounded(p, distance)
        t, _, ray = met(
            sphere, p, np.stack([0.6 + 0 * far, 0 * far, 0 * far]), np.stack([0, 0, -1])
        )
        naive = naive_distance(sphere, ray.o, ray.d).numpy()
        for label, value in (("stable", t), ("textbook quadratic", naive)):
            curves.append(
                Curve(
                    f"{label}, {p.name}",
                    distance,
                    abs(value - far + np.sqrt(1 - rounded(p, 0.6) ** 2)),
                )
            )
    return Chart(
        "A unit sphere far away", "distance", "error of the hit, in radii", tuple(curves), 0.1
    )


# 6: one's own surface

RADII = np.array([1e-4, 1e-2, 1, 1e2, 1e4])


def _on_surface(
    p: Precision, radii: np.ndarray
) -> tuple[Sphere, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Spheres, one a lane, with points on them and directions: sphere, radius, normal, origin,
    direction.
    """
    rng = np.random.default_rng(6)
    radius = np.repeat(radii, 2000)
    n, d = rng.normal(size=(2, 3, radius.size))
    n, d = n / np.linalg.norm(n, axis=0), d / np.linalg.norm(d, axis=0)
    center = np.array([[0.3], [-0.2], [0.5]]) * radius
    return (
        Sphere("", "", vectors_of(p, center), p.real(radius.astype(p.dtype)), False),
        radius,
        n,
        center + radius * n,
        d,
    )


def own_surface(p: Precision) -> Iterator[Check]:
    sphere, radius, n, o, d = _on_surface(p, RADII)
    slope = (n * d).sum(0)
    yield Check("rays that leave outward and hit", count(met(sphere, p, o, d, on=True)[1]), 0)
    t, hit, _ = met(sphere, p, o, d, on=True, inward=True)
    yield Check("rays that leave inward and miss", count(~hit), 0)
    yield Check(
        "chord over radius", worst(((t + 2 * radius * slope) / radius)[slope < 0]), 8 * p.epsilon
    )


def own_surface_chart() -> Chart:
    radii = np.logspace(-4, 4, 17)
    curves = []
    for p in PRECISIONS:
        sphere, _, n, o, d = _on_surface(p, radii)
        inward = (n * d).sum(0) < 0
        t, hit, _ = met(sphere, p, o, d)
        excluded = np.where(
            inward, met(sphere, p, o, d, on=True, inward=True)[1], met(sphere, p, o, d, on=True)[1]
        )
        methods = {
            "excluded by algebra": excluded,
            "t > 0": hit & (t > 0),
            "t > 0.0001": hit & (t > 1e-4),
        }
        for label, hits in methods.items():
            curves.append(
                Curve(f"{label}, {p.name}", radii, (hits != inward).reshape(radii.size, -1).mean(1))
            )
    title = "Rays that leave a sphere: wrong hits outward, and misses inward"
    return Chart(title, "radius", "share of wrong answers", tuple(curves), 1e-3)


# 7: origins and directions


def origins(p: Precision) -> Iterator[Check]:
    d = np.random.default_rng(7).normal(size=(3, 400))
    d /= np.linalg.norm(d, axis=0)
    for radius in (1e-4, 1.0, 1e4):
        center = rounded(p, [1, -2, 0.5])
        t, hit, _ = met(
            _ball(p, tuple(center.tolist()), radius),
            p,
            np.broadcast_to(center[:, None], d.shape),
            d,
        )
        error = worst(t / rounded(p, radius) - 1) if hit.all() else np.nan
        yield Check(f"origin at the centre of radius {radius:g}", error, 4 * p.epsilon)
    _, hit, _ = met(
        _ball(p, (0.0, 0.0, 3.0)), p, np.zeros((3, 1)), np.array([[0.0], [0.0], [-1.0]])
    )
    yield Check("sphere behind: hits", count(hit), 0)
    scene, _, _ = disc(p, 4.0, 1.0, 16, 40.0)
    behind = scene.replace({"spheres.ball.center": [0, 0, 9]})
    yield Check(
        "sphere behind: d image, forward", worst(forward(behind, "spheres.ball.center", "x")), 0
    )
    yield Check(
        "sphere behind: d image, reverse",
        worst(reverse(behind, "spheres.ball.center")["spheres.ball.center"]),
        0,
    )
    yield Check("a view direction of any length", _look_at_error(p), 4 * p.epsilon)


def _look_at_error(p: Precision) -> float:
    """How far the ray through a pixel turns when `look_at` slides along the view."""
    directions = []
    for length in (1e-4, 1.0, 1e4):
        eye = Camera(p.vector(0), p.vector(*(length * x for x in (0.25, -0.5, -1))), p.real(40))
        directions.append(
            primary_ray(camera_frame(eye, p.real(1)), p.real(0.3), p.real(-0.7)).d.numpy()
        )
    return worst(np.array(directions) - directions[1])


CASES = (
    Case(
        1,
        "tangent ray",
        "hit or miss, the same for search and shadow; never NaN",
        "The discriminant is of size 0 beside products of size 10, so it is off by 20 ulp(1), and its root by sqrt(20 ulp).",
        tangent,
        tangent_chart,
        "digits below the rim halve: at 1e-7 below it single precision knows the distance to 3 digits",
    ),
    Case(
        2,
        "distant sphere",
        "silhouette pi r^2 (perspective: pi f^2 r^2 / (d^2 - r^2)) to 0.1 %, without rings",
        "The miss distance is formed before it is squared, so that the discriminant is off by some ulp(r^2) and not ulp(d^2); "
        "the distance itself is rounded to ulp(d). Edges are cut as chords, which costs far less than 0.1 % at 64 x 64, spp 4.",
        distant,
        distant_chart,
    ),
    Case(
        6,
        "own surface",
        "outward: no hit; inward: t = -2 r d.n",
        "Hits are excluded by algebra, exactly. The origin is rounded to 1 ulp(r) on each axis, a chord has three such terms, "
        "twice.",
        own_surface,
        own_surface_chart,
    ),
    Case(
        7,
        "origin and direction",
        "from the centre t = r; a sphere behind is missed with zero gradient; a direction of any length sees the same",
        "A unit direction's norm is off by 1.5 ulp, and t is a root of products of it: 4 ulp. Counts and zeros are exact.",
        origins,
    ),
)
