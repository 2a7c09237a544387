"""What edges add to pixels and gradients: closed forms, each kind of edge alone, and the whole."""

import drjit as dr
import numpy as np
import pytest
from gradcheck import SUM, adjoint_error, directions, image_difference, image_error, jvp
from samples import (
    CHECKER,
    EPSILON,
    FLOOR,
    LIGHT,
    SHIPPED,
    SKY,
    camera,
    disc,
    keys,
    light,
    material,
    scene,
    sun,
    three,
)
from samples import plane as wall
from samples import sphere as ball

from whitted import load_scene, render
from whitted.edges import settings
from whitted.edges.correction import Correction
from whitted.rendering import job
from whitted.tracing.primary import camera_frame, image_ray

AHEAD = camera([0, 0, 4], fov=40, resolution=(32, 32))
GLOW = keys(ambient=[1, 1, 1])
SKY_LIGHT = keys(background=[0.2, 0.4, 0.9])
WHITE, RED = material("white", color=[0.9, 0.8, 0.7]), material("red", color=[0.7, 0.1, 0.2])
BLACK = material("black")
MIRROR = material("mirror", reflection=0.8)
GLASS = material("glass", reflection=0.1, refraction=0.9, ior=1.5)
FRESNEL = material("fresnel", reflection=1.0, refraction=1.0, ior=1.5, fresnel="true")


def only(value, component):
    """The unit tangent of one component."""
    tangent = np.zeros(np.size(value.numpy()))
    tangent[component] = 1
    return tangent


def derivative(loaded, name, component=0, **options):
    values = loaded.parameters(name)
    return jvp(
        lambda moved: render(loaded.replace(moved), **options),
        values,
        {name: only(values[name], component)},
    )


@pytest.mark.parametrize("spp", [1, 4])
@pytest.mark.parametrize(("up", "left"), [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_edge_through_samples_has_its_closed_form(load, precision, spp, up, left):
    """A crease along a diagonal of the image passes through samples, where rounding decides on
    which side of it they lie. Counted on a wrong side, a sample is off by half a pixel.

    Seen from the origin, y = -offset meets x = 1 at v = -offset u: in the quadrant the area below
    it, N^2 / 8 pixels, changes by as much for a unit of offset.
    """
    ahead = camera([0, 0, 0], [0, 0, -1], fov=40, resolution=(32, 32))
    floor, side = wall([0, up, 0], 1, "white"), wall([left, 0, 0], 1, "red")
    loaded = load("max_depth = 1\n" + GLOW + ahead + WHITE + RED + floor + side, precision)
    image, slope = render(loaded, spp).numpy(), derivative(loaded, "planes.plane0.offset", spp=spp)
    rows, columns = (
        slice(16, 32) if up == 1 else slice(0, 16),
        slice(0, 16) if left == 1 else slice(16, 32),
    )
    white, red = np.array([0.9, 0.8, 0.7]), np.array([0.7, 0.1, 0.2])
    # The crease is straight, and so are its level functions: all is exact but for roundings of
    # places, of which there are a few, of numbers up to 32
    rounding = 64 * EPSILON[precision]
    np.testing.assert_allclose(image[rows, columns].sum((0, 1)), 128 * (white + red), rtol=rounding)
    np.testing.assert_allclose(
        slope[rows, columns].sum((0, 1)), -128 * (white - red), rtol=rounding
    )


CLEAR = material("clear", reflection=1.0, refraction=1.0, ior=1.0, fresnel="true")


@pytest.mark.parametrize("spp", [4, 16])
def test_surfaces_that_touch_have_no_crease(load, precision, spp):
    """Seen from within a ball that rests on a floor, the two cross in a circle of some thousandths
    of a radius, by rounding. Its crease would move by a million pixels for a unit of radius.
    """
    near = camera([0.78, 1.2, 4.4], [0.78, -0.75, 0], fov=0.05, resolution=(32, 32))
    resting = ball([0.78, -0.17, 0], 0.58, "clear") + wall([0, 1, 0], 0.75, "white")
    loaded = load(GLOW + near + WHITE + CLEAR + resting, precision)
    slope = derivative(loaded, "spheres.sphere0.radius", spp=spp, terms="boundary")
    np.testing.assert_array_equal(slope, 0)


def test_faint_edges_are_found(load, precision):
    """A ball 1 % darker than what is behind it: were its outline not found, its radius would have
    no derivative. The outline's radius in pixels is that of the cone around the ball, seen from a
    distance of 4.
    """
    grey = material("grey", color=[0.99, 0.99, 0.99])
    loaded = load(
        "background = [1, 1, 1]\n" + GLOW + AHEAD + grey + ball([0, 0, 0], 1, "grey"), precision
    )
    slope = derivative(loaded, "spheres.sphere0.radius", spp=1)
    scale, square = 16 / np.tan(np.radians(20)), 4**2
    area_slope = 2 * np.pi * scale**2 * square / (square - 1) ** 2
    # In strips one pixel wide the edge is straight: a chord of an angle a in place of its arc lacks
    # a^2 / 24
    pixel = np.sqrt(square - 1) / scale
    np.testing.assert_allclose(slope.sum((0, 1)), -0.01 * area_slope, rtol=pixel**2 / 24)


ASKEW = AHEAD + "up = [0.4, 1, 0]\n"
CHECKS = material(
    "checks", color=[0.9, 0.1, 0.2], checker="{ color = [0.1, 0.8, 0.7], size = 0.37 }"
)

# Each kind of edge: scene, parameter, component, and the largest error, relative to the image of
# derivatives. With 16 samples a pixel, an edge is straight over a quarter of a pixel. That alone
# would leave 1 %, as it does where edges are smooth and apart (0.1 % to 1.3 % are left). In pixels
# where edges end, meet or turn back, a quarter of a pixel's edge may be off: of some tenth of all
# pixels that have one, 5 %. Mirrors, glass and checkerboards crowd edges into less than a quarter
# of a pixel, which doubles it (up to 9 %)
KINDS = {
    "silhouette": (
        GLOW + SKY_LIGHT + AHEAD + RED + ball([0.1, 0.2, 0], 0.8, "red"),
        "spheres.sphere0.center",
        0,
        0.05,
    ),
    "silhouette before another": (
        GLOW
        + SKY_LIGHT
        + AHEAD
        + RED
        + WHITE
        + ball([0.1, 0.2, 0.6], 0.5, "red")
        + ball([0.4, 0, -0.5], 0.9, "white"),
        "spheres.sphere0.radius",
        0,
        0.05,
    ),
    "silhouette in a mirror": (
        GLOW
        + SKY_LIGHT
        + AHEAD
        + MIRROR
        + RED
        + ball([0, 0, 0], 1, "mirror")
        + ball([0.9, 0.6, 6], 0.9, "red"),
        "spheres.sphere1.center",
        0,
        0.10,
    ),
    "silhouette through glass": (
        GLOW
        + SKY_LIGHT
        + AHEAD
        + GLASS
        + RED
        + ball([0, 0, 0], 1.1, "glass")
        + ball([0.2, 0.1, -2.2], 0.6, "red"),
        "spheres.sphere1.center",
        0,
        0.10,
    ),
    "index of glass": (
        GLOW
        + SKY_LIGHT
        + AHEAD
        + GLASS
        + RED
        + ball([0, 0, 0], 1.1, "glass")
        + ball([0.2, 0.1, -2.2], 0.6, "red"),
        "materials.glass.ior",
        0,
        0.10,
    ),
    "horizon": (
        GLOW + SKY_LIGHT + AHEAD + RED + wall([0.1, 1, 0], 1, "red"),
        "camera.look_at",
        1,
        0.10,
    ),
    "shadow on a plane": (
        AHEAD
        + WHITE
        + BLACK
        + ball([0.3, 0.2, 0.3], 0.4, "black")
        + wall([0, 0, 1], 1, "white")
        + light([2, 2.5, 3]),
        "spheres.sphere0.radius",
        0,
        0.05,
    ),
    "shadow on a sphere": (
        AHEAD
        + WHITE
        + BLACK
        + ball([0, 0, -0.5], 1.2, "white")
        + ball([0.8, 0.9, 1.2], 0.25, "black")
        + light([2, 2.5, 3]),
        "lights.light0.position",
        0,
        0.05,
    ),
    "shadow in a mirror": (
        AHEAD
        + WHITE
        + BLACK
        + MIRROR
        + ball([0, 0, 0], 1, "mirror")
        + ball([0.2, 0.4, 6.5], 0.4, "black")
        + wall([0, 0, -1], 8, "white")
        + light([0.3, 2.5, 3]),
        "spheres.sphere1.center",
        0,
        0.10,
    ),
    "crease of planes": (
        GLOW + AHEAD + WHITE + RED + wall([0, 1, 0], 0.6, "white") + wall([0, 0.1, 1], 1, "red"),
        "planes.plane0.offset",
        0,
        0.05,
    ),
    "crease of spheres": (
        GLOW
        + SKY_LIGHT
        + AHEAD
        + WHITE
        + RED
        + ball([-0.3, 0, 0], 0.8, "white")
        + ball([0.4, 0.1, 0.1], 0.7, "red"),
        "spheres.sphere1.center",
        2,
        0.05,
    ),
    "sphere through a plane": (
        GLOW
        + AHEAD
        + WHITE
        + RED
        + ball([0.1, 0, 0], 0.9, "red")
        + wall([0.1, 0.2, 1], -0.3, "white"),
        "planes.plane0.offset",
        0,
        0.05,
    ),
    "rim of a disc": (
        GLOW + SKY_LIGHT + AHEAD + RED + disc([0.1, 0.2, 0], [0.3, 0.5, 1], 0.9, "red"),
        "discs.disc0.center",
        0,
        0.05,
    ),
    "rim of a disc that turns": (
        GLOW + SKY_LIGHT + AHEAD + RED + disc([0.1, 0.2, 0], [0.3, 0.5, 1], 0.9, "red"),
        "discs.disc0.normal",
        1,
        0.05,
    ),
    "rim of a disc in a mirror": (
        GLOW
        + SKY_LIGHT
        + AHEAD
        + MIRROR
        + RED
        + ball([0, 0, 0], 1, "mirror")
        + disc([0.9, 0.6, 6], [0.2, 0, 1], 1.1, "red"),
        "discs.disc0.radius",
        0,
        0.10,
    ),
    "disc of mirror": (
        GLOW
        + SKY_LIGHT
        + AHEAD
        + MIRROR
        + RED
        + disc([0, 0, 0], [0.1, 0.3, 1], 1, "mirror")
        + ball([0.9, 0.6, 6], 0.9, "red"),
        "discs.disc0.normal",
        0,
        0.10,
    ),
    "shadow of a disc": (
        AHEAD
        + WHITE
        + BLACK
        + disc([0.3, 0.2, 0.3], [0.4, 1, 0.5], 0.5, "black")
        + wall([0, 0, 1], 1, "white")
        + light([2, 2.5, 3]),
        "discs.disc0.radius",
        0,
        0.05,
    ),
    "shadow of a disc in a mirror": (
        AHEAD
        + WHITE
        + BLACK
        + MIRROR
        + ball([0, 0, 0], 1, "mirror")
        + disc([0.2, 0.4, 6.5], [0.2, 0.5, 1], 0.5, "black")
        + wall([0, 0, -1], 8, "white")
        + light([0.3, 2.5, 3]),
        "discs.disc0.center",
        0,
        0.10,
    ),
    "disc through a ball": (
        GLOW
        + SKY_LIGHT
        + AHEAD
        + WHITE
        + RED
        + ball([0.1, 0, 0], 0.8, "red")
        + disc([0, 0.1, 0.2], [0.2, 1, 0.4], 1.1, "white"),
        "discs.disc0.center",
        1,
        0.05,
    ),
    "shadow by the sun": (
        AHEAD
        + WHITE
        + BLACK
        + ball([0.3, 0.2, 0.3], 0.4, "black")
        + wall([0, 0, 1], 1, "white")
        + sun([-1, -1.2, -2]),
        "lights.light0.direction",
        0,
        0.05,
    ),
    "shadow of a disc by the sun": (
        AHEAD
        + WHITE
        + BLACK
        + disc([0.3, 0.2, 0.3], [0.4, 1, 0.5], 0.5, "black")
        + wall([0, 0, 1], 1, "white")
        + sun([-1, -1.2, -2]),
        "discs.disc0.normal",
        2,
        0.05,
    ),
    "terminator of the sun": (
        AHEAD
        + material("gloss", specular=0.8, shininess=1.5)
        + ball([0, 0, 0], 1.2, "gloss")
        + sun([-4, -1, 0.5]),
        "lights.light0.direction",
        2,
        0.05,
    ),
    "partial shadow": (
        AHEAD
        + WHITE
        + material("veil", shadow=0.6)
        + ball([0.3, 0.2, 0.3], 0.4, "veil")
        + wall([0, 0, 1], 1, "white")
        + light([2, 2.5, 3]),
        "spheres.sphere0.radius",
        0,
        0.05,
    ),
    "partial shadow in a full one": (
        AHEAD
        + WHITE
        + BLACK
        + material("veil", shadow=0.6)
        + ball([0.3, 0.2, 0.3], 0.4, "veil")
        + ball([0.6, 0.6, 0.9], 0.3, "black")
        + wall([0, 0, 1], 1, "white")
        + light([2, 2.5, 3]),
        "lights.light0.position",
        0,
        0.05,
    ),
    "partial shadows across each other": (
        AHEAD
        + WHITE
        + material("veil", shadow=0.6)
        + material("gauze", shadow=0.3)
        + ball([0.3, 0.2, 0.3], 0.4, "veil")
        + ball([0.6, 0.4, 0.4], 0.4, "gauze")
        + wall([0, 0, 1], 1, "white")
        + light([2, 2.5, 3]),
        "spheres.sphere1.center",
        1,
        0.05,
    ),
    "size of a checkerboard": (
        GLOW + ASKEW + CHECKS + wall([0.1, 0.2, 1], 0.5, "checks"),
        "materials.checks.checker.size",
        0,
        0.10,
    ),
    "checkerboard on a disc": (
        GLOW + SKY_LIGHT + ASKEW + CHECKS + disc([0, 0, 0], [0.1, 0.2, 1], 1.2, "checks"),
        "materials.checks.checker.size",
        0,
        0.10,
    ),
    "checkerboard": (
        GLOW + ASKEW + CHECKS + wall([0.1, 0.2, 1], 0.5, "checks"),
        "camera.position",
        0,
        0.10,
    ),
    "terminator": (
        AHEAD
        + material("gloss", specular=0.8, shininess=1.5)
        + ball([0, 0, 0], 1.2, "gloss")
        + light([4, 1, -0.5]),
        "lights.light0.position",
        2,
        0.05,
    ),
    "total reflection": (
        "max_depth = 3\n"
        + SKY_LIGHT
        + AHEAD.replace("[0, 0, 4]", "[0.69, 0, 0]").replace("[0, 0, 0]", "[0.69, 0.1, -1]")
        + GLASS
        + ball([0, 0, 0], 1, "glass"),
        "materials.glass.ior",
        0,
        0.10,
    ),
    "total reflection of a ray that is too faint before": (
        "max_depth = 3\nmin_importance = 0.04\n"
        + SKY_LIGHT
        + AHEAD.replace("[0, 0, 4]", "[0.69, 0, 0]").replace("[0, 0, 0]", "[0.69, 0.1, -1]")
        + FRESNEL
        + ball([0, 0, 0], 1, "fresnel"),
        "materials.fresnel.ior",
        0,
        0.10,
    ),
    "least importance": (
        "min_importance = 0.2\n" + SKY_LIGHT + AHEAD + FRESNEL + ball([0, 0, 0], 1.2, "fresnel"),
        "materials.fresnel.ior",
        0,
        0.10,
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_derivative_by_what_moves_an_edge_is_that_of_differences(load, kind):
    """Differences are of images with 400 samples a pixel, edges and all."""
    text, name, component, bound = KINDS[kind]
    loaded = load(text)
    values = loaded.parameters(name)
    tangents = {name: only(values[name], component)}
    reference, uncertain = image_difference(
        lambda moved: render(loaded.replace(moved), 400), values, tangents
    )
    # The reference must tell an error from the bound
    assert uncertain < bound / 3
    assert image_error(derivative(loaded, name, component, spp=16), reference) < bound
    # So that this could fail: samples alone are far off
    assert (
        image_error(derivative(loaded, name, component, spp=16, boundary=False), reference)
        > 2 * bound
    )


@pytest.mark.parametrize(("depth", "spp"), [(4, 1), (6, 1), (8, 4)])
def test_edges_close_to_a_rim_are_found_from_either_side(load, monkeypatch, depth, spp):
    """A picture upside down has the same derivative, upside down.

    At the rim of a shell of glass the refracted ray has no weight, and much at the next sample,
    which comes before it or after it. A search that weighs a segment by its first end loses edges.
    """
    # Also where edges crowd
    monkeypatch.setattr(settings, "ALL_SEARCHED_SIDE", 1)
    monkeypatch.setattr(settings, "SEARCHED_SIDE", 1)
    air = material("air", reflection=1.0, refraction=1.0, ior=1.0, fresnel="true")
    shell = ball([0, 0, 0], 1.1, "fresnel") + ball([0, 0, 0], 1.05, "air")
    images = []
    for up in (1, -1):
        head = keys(max_depth=depth) + GLOW + SKY_LIGHT + AHEAD
        text = head + FRESNEL + air + RED + shell + wall([0, up, 0], 1.5, "red")
        images.append(derivative(load(text), "spheres.sphere0.radius", spp=spp))
    # Roots are found to 1e-11 of a pixel (a last step below 2^-23, in a search of order 1.6), which
    # derivatives beside a rim magnify up to a thousandfold
    assert image_error(np.flipud(images[1]), images[0]) < 1e-8


@pytest.mark.parametrize("spp", [1, 4, 16])
@pytest.mark.parametrize("name", ["camera.position", "camera.look_at"])
def test_tiles_too_small_to_be_seen_count_as_their_mean(load, name, spp):
    """A floor of small tiles moves as one of their mean colour does, under a bright sky, whose edge
    is found behind any number of tiles.
    """
    ahead = camera([0.1, 0, 4], [0.37, -0.05, 0], fov=6, resolution=(32, 8))
    tiles = material("floor", color=[0.9, 0.1, 0.2], checker={**CHECKER, "size": 0.02})
    floors = tiles, material("floor", color=[0.5, 0.45, 0.45])
    texts = [
        GLOW + "background = [2, 2, 2]\n" + ahead + floor + wall([0, 1, 0], 1.1, "floor")
        for floor in floors
    ]
    small, mean = (derivative(load(text), name, 1, spp=spp).sum(1) for text in texts)
    # The horizon's jump of 1.5 is seen with one tile's colour or the other's, 0.4 from their mean,
    # at 128 places or more: uncertain by 0.4 / sqrt(128), 2.4 % of the jump; twice that at most
    np.testing.assert_allclose(small, mean, atol=0.04 * abs(mean).max())
    # Below the horizon nothing is left of single tiles
    np.testing.assert_array_equal(small[4:], 0)


def test_checker_catches_one_percent(load):
    """An image of derivatives that is 1 % too large is told from the right one."""
    text, name, component, _ = KINDS["crease of planes"]
    loaded = load(text)
    values = loaded.parameters(name)
    reference, uncertain = image_difference(
        lambda moved: render(loaded.replace(moved), 16),
        values,
        {name: only(values[name], component)},
        step=1e-5,
    )
    image = derivative(loaded, name, component, spp=16)
    # A straight edge is exact. Differences with a step h have h^2 = 1e-10 of truncation, and
    # 1e-16 / h = 1e-11 of rounding
    assert uncertain < 1e-9
    assert image_error(image, reference) < 1e-9
    assert image_error(1.01 * image, reference) == pytest.approx(0.01, abs=1e-8)


# The whole


MIXED = scene(three("glass", "mirror", "red"), FLOOR, LIGHT, sky="max_depth = 4\n" + SKY)


@pytest.mark.parametrize("spp", [1, 4])
def test_reverse_mode_is_forward_mode_transposed(load, spp):
    loaded = load(MIXED)
    values = loaded.parameters()
    assert (
        adjoint_error(lambda moved: render(loaded.replace(moved), spp), values, directions(values))
        < SUM
    )


def test_terms_add_up(load):
    loaded = load(MIXED)
    parts = {
        terms: derivative(loaded, "spheres.sphere1.center", terms=terms)
        for terms in ("both", "interior", "boundary")
    }
    # Sums of less than a hundred numbers up to 4, in another order
    np.testing.assert_allclose(
        parts["interior"] + parts["boundary"], parts["both"], rtol=0, atol=1e-13
    )
    assert min(np.linalg.norm(part) for part in parts.values()) > 0.1


GLASS_BALL = SKY_LIGHT + AHEAD + FRESNEL + ball([0, 0, 0], 1, "fresnel")
PERFECT = GLOW + SKY_LIGHT + AHEAD + material("mirror", reflection=1)
IN_RED = GLOW + AHEAD + RED
IN_BOTH = IN_RED + WHITE
FIVE, ONE = (GLOW + camera([0, 0, 4], fov=40, resolution=(n, n)) + RED + WHITE for n in (5, 1))
HARD = {
    "perfect mirror": PERFECT + ball([0, 0, 0], 1, "mirror"),
    "Fresnel rim": GLASS_BALL,
    "edge on a sample": FIVE + wall([1, 0, 0], 0, "white") + wall([0, 0, 1], 1, "red"),
    "one pixel": ONE + ball([0, 0, 0], 0.6, "red"),
    "empty": SKY_LIGHT + AHEAD,
    "one node": "max_depth = 1\n" + GLASS_BALL,
    "sphere over all": IN_RED + ball([0, 0, 0], 3.5, "red"),
    "camera inside": IN_RED + ball([0, 0, 0], 10, "red"),
    "small sphere": IN_RED + ball([0.043, 0.043, 0], 0.004, "red"),
    "grazing edges": IN_BOTH + wall([0, 1, 0], 0.001, "red") + wall([1, 0, 0], 0.001, "white"),
    "crossing edges": SKY_LIGHT
    + IN_BOTH
    + ball([0.3, 0.3, 0], 0.4, "red")
    + ball([-0.3, -0.3, 1], 0.4, "white"),
    "touching": IN_BOTH + ball([0.4, 0, 0], 0.4, "red") + ball([-0.4, 0, 0], 0.4, "white"),
    "twins": IN_BOTH + ball([0, 0, 0], 0.4, "red") + ball([0, 0, 0], 0.4, "white"),
}


@pytest.mark.parametrize("case", HARD)
def test_hard_case_is_finite_and_bounded(load, precision, case):
    """Where a level function has no slope, or an edge no second side, a quotient could be 0 / 0."""
    loaded = load(HARD[case], precision)
    check_finite(loaded)
    names = [name for name in loaded.parameters() if name.endswith(("radius", "offset", "ior"))]
    if names:
        values = loaded.parameters(*names)
        slope = jvp(
            lambda moved: render(loaded.replace(moved)),
            values,
            {name: np.ones(1) for name in names},
        )
        # A pixel has four segments to its neighbours. For each, an edge of a jump up to 1 moves
        # along one pixel's width; a unit of length is 11 pixels; and weights let an edge that is
        # askew count for up to 1.14 of that (`whitted.edges`)
        assert abs(slope).max() < 4 * 11 * 1.14


def check_finite(loaded, **options):
    params = loaded.parameters()
    dr.enable_grad(params)
    image = render(loaded.replace(params), **options)
    assert np.isfinite(dr.detach(image).numpy()).all()
    dr.backward(dr.sum(image.array))
    for name, value in params.items():
        assert np.isfinite(dr.grad(value).numpy()).all(), name


@pytest.mark.slow
@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_gradients_of_example_scenes_are_finite(path):
    """In single precision, whose range is the smaller one."""
    check_finite(load_scene(path), resolution=(24, 24), max_depth=5)


def test_image_in_bands_is_the_image_in_one(load, monkeypatch, precision):
    loaded = load(MIXED, precision)
    whole, slope = render(loaded, 4).numpy(), derivative(loaded, "spheres.sphere0.center", spp=4)
    monkeypatch.setattr(job, "BAND", 16 * 4 * 4)
    np.testing.assert_array_equal(render(loaded, 4).numpy(), whole)
    np.testing.assert_array_equal(derivative(loaded, "spheres.sphere0.center", spp=4), slope)


def test_edges_in_chunks_are_the_edges_in_one(load, monkeypatch, precision):
    """Pixels to the last bit; derivatives but for the order of sums."""
    loaded = load(MIXED, precision)
    whole, slope = render(loaded, 4).numpy(), derivative(loaded, "spheres.sphere0.center", spp=4)
    monkeypatch.setattr(settings, "LANES", 64)
    np.testing.assert_array_equal(render(loaded, 4).numpy(), whole)
    chunked = derivative(loaded, "spheres.sphere0.center", spp=4)
    # A pixel's edges and samples are less than 64
    assert abs(chunked - slope).max() <= 64 * EPSILON[precision] * abs(slope).max()


def test_image_is_the_same_twice(load, precision):
    loaded = load(MIXED, precision)
    np.testing.assert_array_equal(render(loaded, 4).numpy(), render(loaded, 4).numpy())


@pytest.mark.parametrize("spp", [1, 4])
def test_pixels_are_better_than_those_of_sixteen_times_the_samples(load, spp):
    """With edges, an image is better than one of plain samples that traces as many times more."""
    loaded = load(MIXED)
    options = {"resolution": (48, 36)}
    reference = render(loaded, 1024, boundary=False, **options).numpy()
    error = image_error(render(loaded, spp, **options).numpy(), reference)
    assert error < image_error(
        render(loaded, 16 * spp, boundary=False, **options).numpy(), reference
    )


def test_error_of_the_gradient_falls_with_the_samples(load):
    text, name, component, _ = KINDS["silhouette before another"]
    loaded = load(text)
    values = loaded.parameters(name)
    tangents = {name: only(values[name], component)}
    reference, _ = image_difference(
        lambda moved: render(loaded.replace(moved), 1600), values, tangents
    )
    errors = [
        image_error(derivative(loaded, name, component, spp=n * n), reference) for n in (1, 2, 4, 8)
    ]
    # An edge that is straight over a distance h is off by h^2 in each of 1 / h strips
    assert np.polyfit(np.log([1, 2, 4, 8]), np.log(errors), 1)[0] < -1, errors


@pytest.mark.parametrize("spp", [1, 16])
def test_samples_of_a_pixel_count_for_one(monkeypatch, spp):
    """Mirrors that see each other: outlines cross the pairs of many a sample in both directions.

    Samples in crowds, and one beside an edge that was not found, count for less. A sample that
    counted for less than nothing would spoil a pixel, as its derivative may be huge.
    """
    seen = []

    def count(self, images, wrt, directions):
        band, (columns, side) = self.band, (self.band.resolution[0], self.band.side)
        parts = [one.weight for one in self.extra + [one.extra for one in self.traced]]
        pixel = [one.pixel for one in self.extra + [one.extra for one in self.traced]]
        regular = self.weights.numpy()
        total = regular.reshape(band.rows, side, columns, side).mean((1, 3)).ravel()
        np.add.at(total, np.concatenate(pixel), np.concatenate(parts))
        seen.append((total, min(regular.min(), *(part.min(initial=0) for part in parts))))

    monkeypatch.setattr(Correction, "_add_interior", count)
    scene = load_scene(next(path for path in SHIPPED if path.stem == "three_mirror"), "double")
    derivative(scene, "spheres.small.radius", spp=spp, resolution=(40, 40))
    total = np.concatenate([total for total, _ in seen])
    # Sums of some thousand parts
    rounding = 1000 * EPSILON["double"]
    assert min(least for _, least in seen) >= -rounding
    assert total.max() <= 1 + rounding
    assert total.min() >= (1 - rounding if spp == 16 else 0)


@pytest.mark.slow
def test_slivers_between_mirrors_need_their_samples_in_pieces(monkeypatch):
    """Where mirrors touch, what lies between two edges is a hundredth of a pixel wide, and its
    derivative is 10^4 times that of the rest. Two samples of it alone are off twice as far as two
    in each of four pieces.
    """
    path = next(path for path in SHIPPED if path.stem == "three_mirror")
    loaded, name, options = (
        load_scene(path, "double"),
        "spheres.small.radius",
        {"resolution": (32, 32)},
    )
    values = loaded.parameters(name)
    tangents = {name: only(values[name], 0)}
    reference, uncertain = image_difference(
        lambda moved: render(loaded.replace(moved), 6400, **options), values, tangents, 3e-5
    )
    errors = []
    for pieces in (4, 1):
        monkeypatch.setattr(settings, "PIECES", pieces)
        errors.append(image_error(derivative(loaded, name, spp=16, **options), reference))
    # They are 0.07 and 0.15, of a reference that is uncertain by 0.025
    assert uncertain < 0.03
    assert errors[0] + uncertain < errors[1] - uncertain, errors
    assert errors[0] < 0.5 * errors[1], errors


@pytest.mark.parametrize("tilt", [0, 2, 4, 6])
def test_ground_that_runs_off_into_the_distance_between_two_samples_is_integrated(load, tilt):
    """Seen from just above it: all but the nearest ground is within an angle of 0.004, where
    samples are 0.006 apart, and ends at a wall.

    Samples alone are wrong by 0.2 to 3.7, as each counts for what is a tenth as wide.
    """
    ahead = camera([0, 0, 4], [0, tilt * 4e-3, 0], fov=40, resolution=(4, 16))
    ground = wall([0, 1, 0], 0.004, "white") + wall([0, 0, 1], 6, "red")
    scene = load(ahead + WHITE + RED + ground + light([0, 1, 2]), "double")
    values, tangents = (
        scene.parameters("planes.plane0.offset"),
        {"planes.plane0.offset": np.ones(1)},
    )
    reference, _ = image_difference(
        lambda moved: render(scene.replace(moved), 65536), values, tangents, 2e-6
    )
    # The derivative falls like the square of the angle over the whole range between two samples,
    # and Gauss's rule has two points in each quarter of it: it leaves 0.01 to 0.12, most where the
    # wall is right below a sample. The reference, with 64 times as many samples, has 0.01 itself
    error = image_error(
        jvp(lambda moved: render(scene.replace(moved), 16), values, tangents), reference
    )
    assert error < 0.13
    plain = jvp(lambda moved: render(scene.replace(moved), 16, boundary=False), values, tangents)
    assert image_error(plain, reference) > 1.5 * error


def test_dozens_of_edges_between_two_samples_are_all_found():
    """Three pixels of Whitted's picture, at the outline of the glass, which mirrors there all tiles
    that the mirror ball shows.

    A search that gives up after four rounds loses edges whose neighbours would cancel them: errors
    of 40 % to 100 %.
    """
    scene = load_scene(next(path for path in SHIPPED if path.stem == "whitted1980"), "double")
    real = scene.precision.real
    size = scene.precision.vector2(2, 2)
    ahead = image_ray(camera_frame(scene.camera, real(2)), size, real(1.352), real(1.102))
    half = np.tan(np.radians(scene.camera.fov.numpy()[0] / 2))
    name, direction = "spheres.mirror.center", np.array([0.3, -0.8, -0.5])
    zoomed = scene.replace(
        {
            "camera.look_at": (ahead.o + ahead.d).numpy().ravel(),
            "camera.fov": np.degrees(2 * np.arctan(half / 128)),
        }
    )
    values, tangents = zoomed.parameters(name), {name: direction}

    def image(moved, spp=65536, **options):
        return render(zoomed.replace(moved), spp, resolution=(3, 1), **options)

    reference, uncertain = image_difference(
        lambda moved: image(moved, boundary=False), values, tangents, 4e-4
    )
    # The reference is uncertain by 6 %, as a step moves some edges past others; as much again is
    # left to edges closer than a quarter of a pixel
    assert uncertain < 0.06
    assert image_error(jvp(lambda moved: image(moved, 16), values, tangents), reference) < 0.12


def test_suspended_gradients_change_no_pixel(load):
    """Edges are found by derivatives within the kernels, which are recorded once for all calls."""
    scene = load(GLOW + AHEAD + RED + ball([0.1, 0.2, 0], 0.631, "red"), "double")
    with dr.suspend_grad():
        first = render(scene, resolution=(10, 8)).numpy()
    np.testing.assert_array_equal(first, render(scene, resolution=(10, 8)).numpy())
    assert np.abs(first - render(scene, boundary=False, resolution=(10, 8)).numpy()).max() > 0.01
