"""Hard cases of whole scenes: 3 to 5, 21 to 23, 27 and 29."""

import math
from collections.abc import Iterator

import numpy as np

from ..core.arrays import PRECISIONS, Precision
from ..scene.scene import Scene
from .case import Case, Chart, Check, Curve, count, worst
from .scenes import (
    GLASS,
    GLOW,
    SKY,
    WHITE,
    ball,
    camera,
    finite_checks,
    forward,
    lamp,
    material,
    picture,
    reverse,
    scene_of,
    wall,
)

PIXEL = camera((0, 0, 5), (0, 0, 0), 1, (1, 1))
AHEAD = camera((0.1, 0.2, 4), (0, 0, 0), 40, (24, 24))
CLEAR = material("clear", refraction=1, ior=1.5)
RED = material("red", color=[0.8, 0.3, 0.2], specular=0.4, reflection=0.2)
DIM = "background = [0.2, 0.3, 0.5]\nambient = [0.1, 0.1, 0.1]\n"


def _off(image: np.ndarray, expected: np.ndarray, share: float) -> float:
    """The error that this share of the pixels does not exceed."""
    return float(np.quantile(abs(image - expected).max(-1), share))


# 3 and 4: scaled and moved


def _room(p: Precision, scale: float = 1.0, shift: float = 0.0) -> Scene:
    """Glass, mirror and shadow, scaled and then moved."""

    def place(*x: float) -> list[float]:
        return [a * scale + shift for a in x]

    spheres = ball("glass", place(-0.6, 0, 0), 0.6 * scale, "glass") + ball(
        "red", place(0.7, -0.2, 0.3), 0.5 * scale, "red"
    )
    floor = wall("floor", (0, 1, 0), scale - shift, "red")
    view = camera(place(0, 0.5, 4), place(0, 0, 0), 45, (48, 48))
    return scene_of(p, DIM, view, GLASS, RED, spheres, floor, lamp(place(1, 3, 2), (1, 0.9, 0.8)))


def scaled(p: Precision) -> Iterator[Check]:
    image, ahead = picture(_room(p)), forward(_room(p), "spheres.red.center", "x")
    back = reverse(_room(p), "spheres.red.center")["spheres.red.center"]
    for scale in (1e-4, 1e-2, 1e2, 1e4):
        scene = _room(p, scale)
        yield Check(
            f"scale {scale:g}: image, 99 % of its pixels",
            _off(picture(scene), image, 0.99),
            min(1e-5, 100 * p.epsilon),
        )
        slope = forward(scene, "spheres.red.center", "x") * scale
        bound = 100 * p.epsilon * abs(ahead).max()
        yield Check(
            f"scale {scale:g}: d image / d center, 99 % of its pixels",
            _off(slope, ahead, 0.99),
            bound,
        )
        slopes = reverse(scene, "spheres.red.center")["spheres.red.center"] * scale
        # One sample that crosses an edge in rounding may change a sum of thousands
        yield Check(
            f"scale {scale:g}: d sum / d center, relative",
            worst(slopes - back) / worst(back),
            0.01 if p.name == "single" else 1e-7,
        )


def scaled_chart() -> Chart:
    scales, curves = np.logspace(-16, 16, 17), []
    for p in PRECISIONS:
        image = picture(_room(p))
        for label, share in (("9 of 10", 0.9), ("99 %", 0.99)):
            errors = [_off(picture(_room(p, scale)), image, share) for scale in scales.tolist()]
            curves.append(Curve(f"{label} pixels, {p.name}", scales, np.array(errors)))
    return Chart(
        "The same scene at other scales", "scale", "difference of pixels", tuple(curves), 1e-4
    )


def moved(p: Precision) -> Iterator[Check]:
    image = picture(_room(p))
    for shift in (1e3, 1e4, 1e5):
        scene, ulp = _room(p, shift=shift), p.epsilon * shift
        error = picture(scene) - image
        yield Check(f"by {shift:g}: 9 of 10 pixels", _off(picture(scene), image, 0.9), 2 * ulp)
        wrong = abs(error).max(-1) > max(0.02, 10 * ulp)
        yield Check(
            f"by {shift:g}: share of pixels with acne or beside an edge", float(wrong.mean()), 0.05
        )
        yield from finite_checks(scene, f"by {shift:g}", "spheres.glass.center", "x")


def moved_chart() -> Chart:
    shifts, curves = np.logspace(0, 7, 15), []
    for p in PRECISIONS:
        image = picture(_room(p))
        errors = [_off(picture(_room(p, shift=shift)), image, 0.9) for shift in shifts.tolist()]
        curves.append(Curve(f"9 of 10 pixels, {p.name}", shifts, np.array(errors)))
        curves.append(Curve(f"2 ulp(position), {p.name}", shifts, 2 * p.epsilon * shifts))
    return Chart(
        "The same scene far from the origin",
        "moved by",
        "difference of pixels",
        tuple(curves),
        1e-2,
    )


# 5: a sphere for a ground


def _ground(p: Precision, radius: float | None) -> Scene:
    """A ball on a ground that is a sphere, or a plane without a radius."""
    mirror = material("mirror", color=[0.5, 0.4, 0.3], reflection=0.5)
    ground = (
        wall("ground", (0, 1, 0), 1, "mirror")
        if radius is None
        else ball("ground", (0, -radius - 1, 0), radius, "mirror")
    )
    view = camera((0, 0.7, 4), (0, 0, 0), 45, (48, 48))
    return scene_of(
        p,
        DIM,
        view,
        WHITE,
        mirror,
        ball("ball", (0.2, 0.2, 0), 0.6, "white"),
        ground,
        lamp((1, 3, 2)),
    )


def ground(p: Precision) -> Iterator[Check]:
    flat = picture(_ground(p, None))[30:]
    for radius in (1e4, 1e6):
        # Rows that see ground at most some 10 units away, whose height is off by 50 / r, and slopes
        # by 10 / r
        yield Check(
            f"radius {radius:g}: 99 % of near pixels",
            _off(picture(_ground(p, radius))[30:], flat, 0.99),
            60 / radius + 300 * p.epsilon,
        )
    yield from finite_checks(_ground(p, 1e6), "radius 1e6", "spheres.ground.radius")


def ground_chart() -> Chart:
    radii, curves = np.logspace(1, 9, 17), []
    for p in PRECISIONS:
        flat = picture(_ground(p, None))[30:]
        errors = [_off(picture(_ground(p, radius))[30:], flat, 0.99) for radius in radii.tolist()]
        curves.append(Curve(f"99 % of near pixels, {p.name}", radii, np.array(errors)))
    curves.append(Curve("sagitta of 10 units, double", radii, 50 / radii))
    return Chart("A huge sphere for a plane", "radius", "difference of pixels", tuple(curves), 1e-2)


# 21: overlapping glass


def overlapping(p: Precision) -> Iterator[Check]:
    one, two = (
        material("a", refraction=1, ior=1.5, fresnel="true"),
        material("b", refraction=1, ior=2, fresnel="true"),
    )
    pair = ball("one", (0, 0, 0), 1, "a"), ball("two", (0, 0, 0.9), 0.8, "a")
    sky = SKY, "max_depth = 6\n"
    for order in (pair, pair[::-1]):
        # At normal incidence F = 0.04, once on the way in and once on the way out
        error = picture(scene_of(p, *sky, PIXEL, one, *order)) - 0.96**2
        yield Check("one index: transmitted as by the union", worst(error), 16 * p.epsilon)
    first, second = (picture(scene_of(p, *sky, AHEAD, one, *order)) for order in (pair, pair[::-1]))
    yield Check("one index: image in either order", worst(first - second), 0)
    # The smaller sphere, of index 2, fills what both contain
    mixed = scene_of(p, *sky, PIXEL, one, two, pair[0], pair[1].replace('"a"', '"b"'))
    expected = (1 - (1 / 3) ** 2) * (1 - (0.5 / 3.5) ** 2) * 0.96
    yield Check(
        "two indices: the smaller sphere fills", worst(picture(mixed) - expected), 16 * p.epsilon
    )
    yield from finite_checks(mixed, "two indices", "materials.b.ior")


# 22 and 29: camera and lights anywhere


def inside(p: Precision) -> Iterator[Check]:
    def looks_out(x: float) -> Scene:
        glass = GLASS, ball("glass", (0, 0, 0), 1, "glass")
        return scene_of(p, SKY, "max_depth = 2\n", camera((x, 0, 0), (x, 0, -1), 1, (1, 1)), *glass)

    yield Check(
        "camera in glass, beyond the critical angle: what gets out",
        worst(picture(looks_out(0.8))),
        0,
    )
    expected = 1 - _reflectance(math.asin(0.1), 1 / 1.5)
    yield Check(
        "camera in glass, at sin = 0.1: 1 - F",
        worst(picture(looks_out(0.1)) - expected),
        8 * p.epsilon,
    )
    yield from finite_checks(looks_out(0.1), "camera in glass", "materials.glass.ior")
    air = material("air", refraction=1, ior=1)
    lit = PIXEL, WHITE, air, ball("air", (0, 0, 0), 1, "air")
    shadowed = scene_of(p, *lit, wall("back", (0, 0, 1), 2, "white"), lamp((0, 0, 0.5)))
    yield Check("light in glass: radiance of what is outside", worst(picture(shadowed)), 0)
    within = scene_of(p, *lit, ball("within", (0, 0, 0), 0.2, "white"), lamp((0, 0, 0.5)))
    yield Check(
        "light in glass: of what is inside with it, from 1",
        worst(picture(within) - 1),
        4 * p.epsilon,
    )
    for where, scene, expected in _lights(p):
        yield Check(f"light {where}", worst(picture(scene) - expected), 0)
        yield from finite_checks(scene, f"light {where}", "lights.lamp.position", "x")


def _reflectance(theta: float, n: float) -> float:
    t = math.asin(math.sin(theta) / n)
    return (math.sin(theta - t) / math.sin(theta + t)) ** 2 / 2 + (
        math.tan(theta - t) / math.tan(theta + t)
    ) ** 2 / 2


def _lights(p: Precision) -> Iterator[tuple[str, Scene, float]]:
    """Lights at strange places: where, the scene, and the radiance."""
    unit = ball("ball", (0, 0, 0), 1, "white")
    for where, parts, expected in (
        ("at a sphere's centre", (unit, lamp((0, 0, 0))), 0),
        ("and camera within a sphere", (ball("ball", (0, 0, 5), 1, "white"), lamp((0, 0, 5))), 1),
        ("on a sphere", (unit, lamp((0, 0, 1))), 0),
    ):
        yield where, scene_of(p, PIXEL, WHITE, *parts), expected


def planes(p: Precision) -> Iterator[Check]:
    for where, normal, offset in (
        ("along the ray", (0, 1, 0), 0),
        ("parallel to it", (0, 1, 0), 1),
        ("through the camera", (0, 0, 1), -5),
    ):
        scene = scene_of(
            p,
            "background = [0.5, 0.5, 0.5]\n",
            GLOW,
            PIXEL,
            WHITE,
            wall("plane", normal, offset, "white"),
        )
        yield Check(f"plane {where}: seen", count(picture(scene) != 0.5), 0)
        yield from finite_checks(scene, f"plane {where}", "planes.plane.offset")
    for where, position in (("under the pixel", (0, 0, 0)), ("beside it", (1, 0, 0))):
        scene = scene_of(p, PIXEL, WHITE, wall("plane", (0, 0, 1), 0, "white"), lamp(position))
        yield Check(f"light on a plane, {where}: radiance", worst(picture(scene)), 0)
        yield from finite_checks(scene, f"light on a plane, {where}", "lights.lamp.position", "z")


# 23: twins and touching objects


def twins(p: Precision) -> Iterator[Check]:
    materials = WHITE + material("red", color=[1, 0, 0], specular=1, reflection=0.5)
    parts = DIM, AHEAD, materials, lamp((2, 3, 4))
    red = ball("ball", (0, 0, 0), 0.8, "red"), wall("wall", (0, 1, 0.2), 1, "red")
    white = ball("twin", (0, 0, 0), 0.8, "white"), wall("twin_wall", (0, -1, -0.2), -1, "white")
    doubled = scene_of(p, *parts, red[0], white[0], red[1], white[1])
    yield Check(
        "twins: image from that of the first of each",
        worst(picture(doubled) - picture(scene_of(p, *parts, *red))),
        0,
    )
    yield from finite_checks(doubled, "twins", "spheres.twin.radius")
    dense = GLASS.replace("glass", "dense").replace("1.5", "2.0")
    clear = DIM, AHEAD, materials, GLASS, dense, wall("back", (0, 0, 1), 1.5, "white")
    first, second = ball("first", (0, 0, 0), 0.8, "glass"), ball("second", (0, 0, 0), 0.8, "dense")
    lit = lamp((2, 3, 4))
    difference = picture(scene_of(p, *clear, first, second, lit)) - picture(
        scene_of(p, *clear, first, lit)
    )
    yield Check("twins of glass: image from that of the first", worst(difference), 0)
    pair = ball("left", (-0.5, 0, 0), 0.5, "glass") + ball("right", (0.5, 0, 0), 0.5, "white")
    view = camera((0, 0, 4), (0, 0, 0), 40, (25, 25))
    touching = scene_of(
        p, DIM, view, GLASS, WHITE, pair, wall("floor", (0, 1, 0), 0.5, "white"), lamp((2, 3, 4))
    )
    yield from finite_checks(touching, "touching spheres and plane", "spheres.left.center", "x")


# 27: small and empty


def degenerate(p: Precision) -> Iterator[Check]:
    quarter, side = "background = [0.25, 0.25, 0.25]\n", 2.0**-20
    for x in (1.0, 1 - side, 1 + side):
        view = camera((x, 0, 5), (x, 0, 0), 1, (1, 1))
        for of in ("white", "glass"):
            scene = scene_of(
                p,
                quarter,
                GLOW,
                view,
                WHITE,
                GLASS,
                ball("ball", (0, 0, 0), 1, of),
                wall("back", (0, 0, 1), 9, "white"),
            )
            yield from finite_checks(
                scene, f"{of} edge at {x - 1:g} of the pixel's centre", "spheres.ball.radius"
            )
    empty = scene_of(p, quarter, AHEAD)
    yield Check("empty scene: its background", worst(picture(empty) - 0.25), 0)
    yield Check(
        "empty scene: d sum / d background, of the number of pixels",
        worst(reverse(empty, "background")["background"] - 24 * 24),
        0,
    )
    one = scene_of(p, SKY, "max_depth = 1\n", AHEAD, GLASS, ball("ball", (0, 0, 0), 1, "glass"))
    yield from finite_checks(one, "one node", "materials.glass.ior")
    white = ball("ball", (0.1, 0.2, 4), 7, "white")
    covered = scene_of(p, AHEAD, WHITE, white, lamp((0.1, 0.2, 4)))
    yield Check(
        "sphere that covers the image, lit head-on, from 1",
        worst(picture(covered) - 1),
        8 * p.epsilon,
    )
    yield from finite_checks(covered, "sphere that covers the image", "spheres.ball.radius")


CASES = (
    Case(
        3,
        "scaled scene",
        "the same image, and derivatives by positions that are 1 / s as large",
        "Scaling by powers of ten rounds every number once; glass magnifies that up to a hundredfold. Of 2304 pixels 1 % may "
        "lie on an edge "
        "that a rounding moves across a sample.",
        scaled,
        scaled_chart,
        "numbers overflow where squares of lengths do, at scales of 1e18 and 1e-18",
    ),
    Case(
        4,
        "moved scene",
        "no acne; an error that grows like ulp(position)",
        "Positions are rounded to half an ulp(shift) on each axis, and colours have slopes of about 1: 2 ulp for most pixels. "
        "Acne would be dark "
        "where it should be bright, in a large share of them.",
        moved,
        moved_chart,
        "moved by 1e5 radii, a position has two digits behind the point, and pixels as many",
    ),
    Case(
        5,
        "ground sphere",
        "a sphere of radius 1e6 shows the plane's image, to the sagitta x^2 / 2 r",
        "At 10 units the ground is 50 / r lower and its normal turned by 10 / r, against which colours have slopes below 1. "
        "A height above the ground is a difference of numbers of size 1, whatever the radius, as sums are compensated.",
        ground,
        ground_chart,
    ),
    Case(
        21,
        "overlapping glass",
        "spheres of one index are their union; of two, the smaller fills what both contain",
        "Products of two or three transmittances, each off by some 4 ulp; images in either order take the same steps.",
        overlapping,
    ),
    Case(
        22,
        "camera and lights inside",
        "defined and finite: camera and light in glass, light on a surface and at a sphere's centre",
        "Zeros and ones are exact, transmittances off by 8 ulp, cosines by 4.",
        inside,
    ),
    Case(
        23,
        "twins and touching objects",
        "of two that coincide the first in the file decides; all is finite",
        "Images are equal bit by bit.",
        twins,
    ),
    Case(
        27,
        "degenerate images",
        "an edge on a pixel's centre, one pixel, no object, one node, a sphere over all: defined, no NaN",
        "Exact, but for a cosine of two normalised vectors, 8 ulp.",
        degenerate,
    ),
    Case(
        29,
        "planes along rays",
        "a plane parallel to the ray or through the camera is missed; a light on a plane leaves it dark",
        "Exact: no tolerance is needed.",
        planes,
    ),
)
