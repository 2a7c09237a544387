"""Hard cases of places: 22, 23, 27 and 29, where rays start, end or touch in unusual places."""

import math
from collections.abc import Iterator

from ..core.arrays import Precision
from ..scene.scene import Scene
from .arrays import count, worst
from .case import Case, Check
from .scenes import (
    GLASS,
    PIXEL,
    WHITE,
    WHITE_AMBIENT,
    WHITE_SKY,
    ball,
    camera,
    finite_checks,
    lamp,
    material,
    picture,
    reverse,
    scene_of,
    wall,
)

VIEW = camera((0.1, 0.2, 4), (0, 0, 0), 40, (24, 24))
DIM = "background = [0.2, 0.3, 0.5]\nambient = [0.1, 0.1, 0.1]\n"

# 22: camera and lights inside


def inside(p: Precision) -> Iterator[Check]:
    yield from _camera_in_glass(p)
    air = material("air", refraction=1, ior=1)
    lit = PIXEL, WHITE, air, ball("air", (0, 0, 0), 1, "air"), lamp((0, 0, 0.5))
    outside = scene_of(p, *lit, wall("back", (0, 0, 1), 2, "white"))
    yield Check("light in glass: radiance of a wall outside", worst(picture(outside)), 0)
    within = scene_of(p, *lit, ball("within", (0, 0, 0), 0.2, "white"))
    error = worst(picture(within) - 1)
    yield Check("light in glass: radiance of a ball inside, from 1", error, 4 * p.epsilon)
    for where, scene, expected in _lights(p):
        yield Check(f"light {where}: radiance", worst(picture(scene) - expected), 0)
        yield from finite_checks(scene, f"light {where}", "lights.lamp.position", "x")


def _camera_in_glass(p: Precision) -> Iterator[Check]:
    def looking_out(x: float) -> Scene:
        """A camera in a glass sphere at (x, 0, 0), whose ray meets the sphere at sin = x."""
        glass = GLASS, ball("glass", (0, 0, 0), 1, "glass")
        view = camera((x, 0, 0), (x, 0, -1), 1, (1, 1))
        return scene_of(p, WHITE_SKY, "max_depth = 2\n", view, *glass)

    error = worst(picture(looking_out(0.8)))
    yield Check("camera in glass, beyond the critical angle: transmittance", error, 0)
    transmittance = 1 - _reflectance(math.asin(0.1), 1 / 1.5)
    error = worst(picture(looking_out(0.1)) - transmittance)
    yield Check("camera in glass, at sin = 0.1: transmittance", error, 8 * p.epsilon)
    yield from finite_checks(looking_out(0.1), "camera in glass", "materials.glass.ior")


def _reflectance(theta: float, n: float) -> float:
    """The Fresnel reflectance by the angles of incidence and transmission."""
    t = math.asin(math.sin(theta) / n)
    r_s = math.sin(theta - t) / math.sin(theta + t)
    r_p = math.tan(theta - t) / math.tan(theta + t)
    return (r_s**2 + r_p**2) / 2


def _lights(p: Precision) -> Iterator[tuple[str, Scene, float]]:
    """Lights in unusual places: where, the scene, and the radiance of its pixel."""
    unit = ball("ball", (0, 0, 0), 1, "white")
    around_camera = ball("ball", (0, 0, 5), 1, "white")
    yield "at a sphere's centre", scene_of(p, PIXEL, WHITE, unit, lamp((0, 0, 0))), 0
    yield (
        "and camera at a sphere's centre",
        scene_of(p, PIXEL, WHITE, around_camera, lamp((0, 0, 5))),
        1,
    )
    yield "on a sphere", scene_of(p, PIXEL, WHITE, unit, lamp((0, 0, 1))), 0


# 23: coinciding and touching objects


def twins(p: Precision) -> Iterator[Check]:
    materials = WHITE + material("red", color=[1, 0, 0], specular=1, reflection=0.5)
    light = lamp((2, 3, 4))
    parts = DIM, VIEW, materials, light
    red, red_wall = ball("ball", (0, 0, 0), 0.8, "red"), wall("wall", (0, 1, 0.2), 1, "red")
    white = ball("twin", (0, 0, 0), 0.8, "white")
    white_wall = wall("twin_wall", (0, -1, -0.2), -1, "white")
    doubled = scene_of(p, *parts, red, white, red_wall, white_wall)
    error = worst(picture(doubled) - picture(scene_of(p, *parts, red, red_wall)))
    yield Check("twins: image, from that of the first of each", error, 0)
    yield from finite_checks(doubled, "twins", "spheres.twin.radius")
    dense = material("dense", reflection=1, refraction=1, ior=2.0, fresnel="true")
    clear = DIM, VIEW, materials, GLASS, dense, wall("back", (0, 0, 1), 1.5, "white"), light
    first, second = ball("first", (0, 0, 0), 0.8, "glass"), ball("second", (0, 0, 0), 0.8, "dense")
    error = worst(picture(scene_of(p, *clear, first, second)) - picture(scene_of(p, *clear, first)))
    yield Check("twins of glass: image, from that of the first", error, 0)
    pair = ball("left", (-0.5, 0, 0), 0.5, "glass") + ball("right", (0.5, 0, 0), 0.5, "white")
    view = camera((0, 0, 4), (0, 0, 0), 40, (25, 25))
    floor = wall("floor", (0, 1, 0), 0.5, "white")
    touching = scene_of(p, DIM, view, GLASS, WHITE, pair, floor, light)
    yield from finite_checks(touching, "touching spheres and plane", "spheres.left.center", "x")


# 27: degenerate images


def degenerate(p: Precision) -> Iterator[Check]:
    yield from _edge_on_sample(p)
    empty = scene_of(p, "background = [0.25, 0.25, 0.25]\n", VIEW)
    yield Check("empty scene: background", worst(picture(empty) - 0.25), 0)
    error = worst(reverse(empty, "background")["background"] - 24 * 24)
    yield Check("empty scene: d sum / d background, from the number of pixels", error, 0)
    glass = ball("ball", (0, 0, 0), 1, "glass")
    shallow = scene_of(p, WHITE_SKY, "max_depth = 1\n", VIEW, GLASS, glass)
    yield from finite_checks(shallow, "max_depth 1", "materials.glass.ior")
    around_camera = ball("ball", (0.1, 0.2, 4), 7, "white")
    covered = scene_of(p, VIEW, WHITE, around_camera, lamp((0.1, 0.2, 4)))
    error = worst(picture(covered) - 1)
    yield Check("sphere around camera and light: radiance, from 1", error, 8 * p.epsilon)
    yield from finite_checks(covered, "sphere around camera and light", "spheres.ball.radius")


def _edge_on_sample(p: Precision) -> Iterator[Check]:
    """A sphere's edge on a pixel's centre, and beside it."""
    grey, gap = "background = [0.25, 0.25, 0.25]\n", 2.0**-20
    back = wall("back", (0, 0, 1), 9, "white")
    for x in (1.0, 1 - gap, 1 + gap):
        view = camera((x, 0, 5), (x, 0, 0), 1, (1, 1))
        for made_of in ("white", "glass"):
            sphere = ball("ball", (0, 0, 0), 1, made_of)
            scene = scene_of(p, grey, WHITE_AMBIENT, view, WHITE, GLASS, sphere, back)
            what = f"{made_of} edge at {x - 1:g} from the pixel's centre"
            yield from finite_checks(scene, what, "spheres.ball.radius")


# 29: planes along rays


def planes(p: Precision) -> Iterator[Check]:
    grey = "background = [0.5, 0.5, 0.5]\n"
    for where, normal, offset in (
        ("that contains the ray", (0, 1, 0), 0),
        ("parallel to the ray", (0, 1, 0), 1),
        ("through the camera", (0, 0, 1), -5),
    ):
        plane = wall("plane", normal, offset, "white")
        scene = scene_of(p, grey, WHITE_AMBIENT, PIXEL, WHITE, plane)
        yield Check(f"plane {where}: hits", count(picture(scene) != 0.5), 0)
        yield from finite_checks(scene, f"plane {where}", "planes.plane.offset")
    for where, position in (("where the ray ends", (0, 0, 0)), ("beside the ray", (1, 0, 0))):
        scene = scene_of(p, PIXEL, WHITE, wall("plane", (0, 0, 1), 0, "white"), lamp(position))
        yield Check(f"light on a plane, {where}: radiance", worst(picture(scene)), 0)
        yield from finite_checks(scene, f"light on a plane, {where}", "lights.lamp.position", "z")


CASES = (
    Case(
        22,
        "camera and lights inside",
        "defined and finite: camera and light in glass, light on a surface or at a sphere's centre",
        "Zeros and ones are exact. Transmittances are off by 8 ulp, cosines by 4.",
        inside,
    ),
    Case(
        23,
        "twins and touching objects",
        "of two objects that coincide the first in the file is seen; all is finite",
        "Images are equal bit by bit.",
        twins,
    ),
    Case(
        27,
        "degenerate images",
        "defined, never NaN: an edge on a pixel's centre, one pixel, no object, max_depth 1, a "
        "sphere that covers the image",
        "Exact, except for a cosine of two normalised vectors: 8 ulp.",
        degenerate,
    ),
    Case(
        29,
        "planes along rays",
        "a plane that is parallel to the ray or contains the camera is missed; a light on a plane "
        "leaves it dark",
        "Exact.",
        planes,
    ),
)
