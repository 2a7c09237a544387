"""Hard cases of mirrors: 16 and 17."""

from collections.abc import Iterator

import numpy as np

from ..core.arrays import Precision
from ..core.ray import NONE
from ..tracing.intersect import closest_hit
from ..tracing.optics import reflect
from .arrays import count, rays_of, rounded, vectors_of, worst
from .case import Case, Check
from .chains import follow
from .scenes import PIXEL, WHITE_AMBIENT, ball, camera, material, picture, scene_of, wall

# 16: a spherical mirror


def mirror_sphere(p: Precision) -> Iterator[Check]:
    rng = np.random.default_rng(16)
    d, n = rng.normal(size=(2, 3, 2000))
    d, n = (rounded(p, v / np.linalg.norm(v, axis=0)) for v in (d, n))
    out = reflect(vectors_of(p, d), vectors_of(p, n)).numpy().astype(np.float64)
    yield Check("d - 2 (d . n) n", worst(out - (d - 2 * (d * n).sum(0) * n)), 4 * p.epsilon)
    half_mirror = material("m", color=[0.5, 0.5, 0.5], reflection=0.5)
    scene = scene_of(p, WHITE_AMBIENT, PIXEL, half_mirror, ball("ball", (0, 0, 5), 2, "m"))
    ray = rays_of(p, np.array([[0.0], [0.0], [5.0]]), d)
    for bounces in (1, 2, 6):
        last = follow(scene, ray, "r" * bounces)
        error = worst(last.d.numpy().astype(np.float64) - (-1) ** bounces * d)
        what = f"from the centre, {bounces} bounces: direction"
        yield Check(what, error, 6 * 3**bounces * p.epsilon)
    error = worst(picture(scene, max_depth=6) - sum(0.5**k / 2 for k in range(6)))
    yield Check("camera at the centre: sum of 0.5^k", error, 4 * p.epsilon)


# 17: facing mirrors and a corner


def mirrors(p: Precision) -> Iterator[Check]:
    mirror = material("m", color=[1, 1, 1], reflection=0.75)
    facing = wall("one", (0, 0, 1), 1, "m") + wall("two", (0, 0, -1), 6, "m")
    scene = scene_of(p, WHITE_AMBIENT, PIXEL, mirror, facing)
    for depth in (1, 2, 7, 20):
        error = worst(picture(scene, max_depth=depth) / ((1 - 0.75**depth) / 0.25) - 1)
        yield Check(f"facing mirrors, depth {depth}: sum of 0.75^k", error, 2 * depth * p.epsilon)
    walls = (wall(f"w{k}", np.eye(3, dtype=int)[k].tolist(), 0, "m") for k in range(3))
    eye = camera((3, 5, 4), (0, 0, 0), 1, (1, 1))
    corner = scene_of(p, eye, material("m", reflection=1), *walls)
    d = np.random.default_rng(17).uniform(-1, -0.2, (3, 500))
    d = rounded(p, d / np.linalg.norm(d, axis=0))
    ray = follow(corner, rays_of(p, np.array([[3.0], [5.0], [4.0]]), d), "rrr")
    kept = closest_hit(corner, ray).index.numpy() != NONE
    yield Check("corner: rays that do not leave after three bounces", count(kept), 0)
    yield Check("corner: sum of directions out and in", worst(ray.d.numpy() + d), 4 * p.epsilon)


CASES = (
    Case(
        16,
        "mirror sphere",
        "d - 2 (d . n) n; from the centre of a mirror the ray returns on itself",
        "The direction is made of two products and sums of numbers up to 2. A ray that passes the "
        "centre at a distance of e meets the sphere e / r off its axis, which turns it by 2 e / r "
        "more. So each bounce triples the error.",
        mirror_sphere,
    ),
    Case(
        17,
        "facing mirrors",
        "the sum of reflection^k, cut exactly at max_depth; a corner of three mirrors returns a "
        "ray parallel to itself",
        "A product and a sum for each surface; reflection at coordinate planes only changes signs.",
        mirrors,
    ),
)
