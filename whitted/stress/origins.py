"""Hard cases of where rays start: 6 and 7, on a surface, inside a sphere, at the camera."""

from collections.abc import Iterator

import numpy as np

from ..core.arrays import PRECISIONS, Precision
from ..scene.camera import Camera
from ..shapes import Sphere
from ..tracing.primary import camera_frame, image_ray
from .arrays import count, numbers_of, rounded, vectors_of, worst
from .case import Case, Chart, Check, Curve
from .rays import intersect, sphere_at
from .scenes import forward, reverse, white_ball

# 6: rays that leave a sphere's surface

RADII = np.array([1e-4, 1e-2, 1, 1e2, 1e4])


def _surface_points(
    p: Precision, radii: np.ndarray
) -> tuple[Sphere, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """2000 random points on spheres of each radius, with random directions.

    Returns:
        The spheres, one per lane, then radii, normals, points and directions.
    """
    rng = np.random.default_rng(6)
    radius = np.repeat(radii, 2000)
    n, d = rng.normal(size=(2, 3, radius.size))
    n, d = n / np.linalg.norm(n, axis=0), d / np.linalg.norm(d, axis=0)
    center = np.array([[0.3], [-0.2], [0.5]]) * radius
    sphere = Sphere("", "", vectors_of(p, center), numbers_of(p, radius))
    return sphere, radius, n, center + radius * n, d


def own_surface(p: Precision) -> Iterator[Check]:
    sphere, radius, n, o, d = _surface_points(p, RADII)
    cosine = (n * d).sum(0)
    _, hit, _ = intersect(sphere, p, o, d, on=True)
    yield Check("rays that leave outward and hit", count(hit), 0)
    t, hit, _ = intersect(sphere, p, o, d, on=True, inward=True)
    yield Check("rays that leave inward and miss", count(~hit), 0)
    error = (t + 2 * radius * cosine) / radius
    yield Check("error of the chord, over the radius", worst(error[cosine < 0]), 8 * p.epsilon)


def own_surface_chart() -> Chart:
    radii = np.logspace(-4, 4, 17)
    curves = []
    for p in PRECISIONS:
        sphere, _, n, o, d = _surface_points(p, radii)
        inward = (n * d).sum(0) < 0
        t, hit, _ = intersect(sphere, p, o, d)
        _, hit_inward, _ = intersect(sphere, p, o, d, on=True, inward=True)
        _, hit_outward, _ = intersect(sphere, p, o, d, on=True)
        methods = {
            "source known (ours)": np.where(inward, hit_inward, hit_outward),
            "t > 0": hit & (t > 0),
            "t > 0.0001": hit & (t > 1e-4),
        }
        for label, hits in methods.items():
            wrong = (hits != inward).reshape(radii.size, -1).mean(1)
            curves.append(Curve(f"{label}, {p.name}", radii, wrong))
    title = "Rays that leave a sphere: wrong hits outward, and misses inward"
    return Chart(
        title, "radius (scene units)", "share of wrong answers (1 is all)", tuple(curves), 1e-3
    )


# 7: origins and directions


def origins(p: Precision) -> Iterator[Check]:
    yield from _from_center(p)
    sphere = sphere_at(p, (0.0, 0.0, 3.0))
    _, hit, _ = intersect(sphere, p, np.zeros((3, 1)), np.array([[0.0], [0.0], [-1.0]]))
    yield Check("sphere behind: hits", count(hit), 0)
    scene, _ = white_ball(p, 4.0, 1.0, 16, 40.0)
    name = "spheres.ball.center"
    behind = scene.replace({name: [0, 0, 9]})
    by_forward, by_reverse = worst(forward(behind, name, "x")), worst(reverse(behind, name)[name])
    yield Check("sphere behind: d image, forward", by_forward, 0)
    yield Check("sphere behind: d image, reverse", by_reverse, 0)
    yield Check("view directions of other lengths", _look_at_error(p), 4 * p.epsilon)


def _from_center(p: Precision) -> Iterator[Check]:
    d = np.random.default_rng(7).normal(size=(3, 400))
    d /= np.linalg.norm(d, axis=0)
    center = rounded(p, [1, -2, 0.5])
    for radius in (1e-4, 1.0, 1e4):
        sphere = sphere_at(p, tuple(center.tolist()), radius)
        t, hit, _ = intersect(sphere, p, np.broadcast_to(center[:, None], d.shape), d)
        error = worst(t / rounded(p, radius) - 1) if hit.all() else np.nan
        yield Check(f"origin at the centre of radius {radius:g}", error, 4 * p.epsilon)


def _look_at_error(p: Precision) -> float:
    """How much the ray through a pixel changes when `look_at` moves along the view direction."""
    directions = []
    for length in (1e-4, 1.0, 1e4):
        target = p.vector(*(length * x for x in (0.25, -0.5, -1)))
        frame = camera_frame(Camera(p.vector(0), target, p.real(40)), p.real(2))
        ray = image_ray(frame, p.vector2(2, 2), p.real(1.3), p.real(1.7))
        directions.append(ray.d.numpy())
    return worst(np.array(directions) - directions[1])


CASES = (
    Case(
        6,
        "own surface",
        "a ray that leaves outward misses the sphere, one that leaves inward hits it at -2 r d.n",
        "A ray knows the surface that it starts on, so hits and misses are exact. The origin is "
        "rounded to 1 ulp(r) on each axis, and the chord sums three such terms, twice.",
        own_surface,
        own_surface_chart,
    ),
    Case(
        7,
        "origin and direction",
        "from the centre t = r; a sphere behind is missed, with gradient 0; the length of the view "
        "direction does not matter",
        "The norm of a unit direction is off by 1.5 ulp, and t is a root of products of it: 4 ulp. "
        "Counts and zeros are exact.",
        origins,
    ),
)
