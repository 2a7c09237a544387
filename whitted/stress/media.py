"""Hard cases of media within media: 19 to 21."""

from collections.abc import Iterator

import drjit as dr
import numpy as np

from ..core.arrays import Precision
from ..tracing.intersect import closest_hit
from .arrays import count, numbers_of, rounded, worst
from .case import Case, Check
from .chains import follow, parallel_rays
from .scenes import (
    CLEAR,
    PIXEL,
    WHITE,
    WHITE_AMBIENT,
    WHITE_SKY,
    ball,
    camera,
    disc,
    finite_checks,
    lamp,
    material,
    picture,
    scene_of,
    slope_checks,
    total,
    wall,
)

VIEW = camera((0.1, 0.2, 4), (0, 0, 0), 40, (24, 24))

# 19: a ball in glass


def ball_in_glass(p: Precision) -> Iterator[Check]:
    inner, n = 0.4, 1.5
    balls = ball("glass", (0, 0, 0), 1, "clear") + ball("inside", (0, 0, 0), inner, "white")
    scene = scene_of(p, PIXEL, CLEAR, WHITE, balls)
    offset = np.concatenate([-np.logspace(-15, -1, 57), np.logspace(-15, -1, 57)])
    height = rounded(p, n * inner * (1 + offset))
    ray = follow(scene, parallel_rays(p, numbers_of(p, height)), "t")
    hit = closest_hit(scene, ray).index.numpy() == 1
    apparent = n * rounded(p, inner)
    clear = abs(height / apparent - 1) > 20 * p.epsilon
    wrong = (hit != (height < apparent)) & clear
    yield Check("rays on the wrong side of the apparent radius n b", count(wrong), 0)
    # From the camera the ball looks like one of radius n b without glass
    side, distance, fov = 64, 4.0, 25.0
    view = camera((0, 0, distance), (0, 0, 0), fov, (side, side))
    scene = scene_of(p, WHITE_AMBIENT, view, CLEAR, WHITE, balls)
    expected = disc(distance, n * inner, side, fov)
    area = total(picture(scene, 4, boundary=True))
    yield Check("area, relative", abs(area / expected.area - 1), 1e-3)
    for name, slope in (
        ("materials.clear.ior", expected.by_radius * inner),
        ("spheres.inside.radius", expected.by_radius * n),
    ):
        yield from slope_checks(scene, name, None, slope, 1e-2, 4, boundary=True)


# 20: shell, bubble, equal indices


def shells(p: Precision) -> Iterator[Check]:
    yield from _bubble(p)
    glass = ball("glass", (0, 0, 0), 1, "clear")
    room = (
        WHITE_SKY,
        "ambient = [0.2, 0.2, 0.2]\n",
        "max_depth = 7\n",
        VIEW,
        CLEAR,
        WHITE,
        wall("back", (0.2, 0, 1), 1.5, "white"),
        glass,
    )
    light = lamp((3, 3, 4))
    with_ball = picture(scene_of(p, *room, ball("inside", (0.2, 0, 0.1), 0.5, "clear"), light))
    error = np.sort(abs(with_ball - picture(scene_of(p, *room, light))).max(-1).ravel())
    # At the rim, glass magnifies a rounding by 1 / cos. It may move an edge of the shadow across a
    # sample; 1 % of the pixels are left out for that.
    what = "equal index within glass: image, from that without, 99 % of its pixels"
    yield Check(what, error[int(0.99 * error.size)], 100 * p.epsilon)


def _bubble(p: Precision) -> Iterator[Check]:
    """Rays through a sphere of glass with a bubble of air in the middle."""
    air = material("air", refraction=1, ior=1)
    glass, bubble = ball("glass", (0, 0, 0), 1, "clear"), ball("bubble", (0, 0, 0), 0.5, "air")
    scene = scene_of(p, PIXEL, CLEAR, air, glass, bubble)
    height = np.linspace(0.01, 0.45, 45)
    rays = parallel_rays(p, numbers_of(p, height))
    within = follow(scene, rays, "tt")
    # n r sin is the same on every shell (Snell), so the ray passes the centre at its first height
    distance = dr.norm(dr.cross(within.o, within.d)).numpy()
    error = worst(distance - rounded(p, height))
    yield Check("bubble: distance of the ray from the centre", error, 16 * p.epsilon)
    out = follow(scene, rays, "tttt")
    # In through glass and bubble, whose index relative to the glass is 1 / 1.5; out likewise
    turn = 2 * (
        np.arcsin(height)
        - np.arcsin(height / 1.5)
        + np.arcsin(height / 0.75)
        - np.arcsin(height / 0.5)
    )
    error = worst(np.arctan2(out.d.x.numpy(), -out.d.z.numpy()) + turn)
    yield Check("bubble: turn of the ray", error, 64 * p.epsilon)


# 21: overlapping glass


def overlapping(p: Precision) -> Iterator[Check]:
    first = material("a", refraction=1, ior=1.5, fresnel="true")
    second = material("b", refraction=1, ior=2, fresnel="true")
    large, small = ball("one", (0, 0, 0), 1, "a"), ball("two", (0, 0, 0.9), 0.8, "a")
    sky = WHITE_SKY, "max_depth = 6\n"
    for order in ((large, small), (small, large)):
        # At normal incidence F = 0.04, once on the way in and once on the way out
        error = worst(picture(scene_of(p, *sky, PIXEL, first, *order)) - 0.96**2)
        yield Check("one index: transmittance of the union", error, 16 * p.epsilon)
    images = [
        picture(scene_of(p, *sky, VIEW, first, *order))
        for order in ((large, small), (small, large))
    ]
    yield Check("one index: image in either order", worst(images[0] - images[1]), 0)
    # The smaller sphere, of index 2, fills what both contain
    denser = ball("two", (0, 0, 0.9), 0.8, "b")
    mixed = scene_of(p, *sky, PIXEL, first, second, large, denser)
    expected = (1 - (1 / 3) ** 2) * (1 - (0.5 / 3.5) ** 2) * 0.96
    error = worst(picture(mixed) - expected)
    yield Check("two indices: transmittance if the smaller fills", error, 16 * p.epsilon)
    yield from finite_checks(mixed, "two indices", "materials.b.ior")


CASES = (
    Case(
        19,
        "ball in glass",
        "an opaque ball of radius b within glass has the apparent radius n b; its area, and the "
        "derivatives of the area by n and b, in closed form",
        "Two square roots and a refraction round the ray by 20 ulp. Edges through glass are chords "
        "between samples, whose error is of second order in their spacing, 1/40 of the radius.",
        ball_in_glass,
    ),
    Case(
        20,
        "shells and bubbles",
        "media refract by their relative index; a ball of equal index within glass is invisible",
        "Each of two refractions keeps n r sin, up to 4 ulp. The turn sums four angles, each of "
        "which magnifies that error by 1 / cos, up to 2.3.",
        shells,
    ),
    Case(
        21,
        "overlapping glass",
        "spheres of one index are their union; of two indices, the smaller sphere fills what both "
        "contain",
        "Products of two or three transmittances, each off by about 4 ulp. Images in either order "
        "take the same steps.",
        overlapping,
    ),
)
