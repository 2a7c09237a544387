"""The tracer against the contract's equations, and against closed forms."""

import math

import drjit as dr
import numpy as np
import pytest
from reference import Reference
from samples import LIGHT, SCENES, plane, random_scene, sphere
from samples import render_plain as render

from whitted.geometry import NONE, Ray
from whitted.scene import closest_hit
from whitted.surface import surface
from whitted.trace import scatter

# A camera at z = 5 above (0, 0) that looks down the z axis, with one pixel
AXIS = "[camera]\nposition = [{x}, {y}, 5]\nlook_at = [{x}, {y}, 0]\nfov = 1\nresolution = [1, 1]\n"
GLASS = "[materials.glass]\nreflection = 1\nrefraction = 1\nior = 1.5\nfresnel = true\n"
CLEAR = "[materials.clear]\nrefraction = 1\nior = 1.5\n"
WHITE = "[materials.white]\ncolor = [1, 1, 1]\n"
CHECKS = "[materials.checks]\ncolor = [1, 0, 0]\nchecker = { color = [0, 1, 0.5], size = 0.3 }\n"
BACKDROP = plane([0, 0, 1], 1.5, "checks")
CAMERA = "[camera]\nposition = [0.1, 0.2, 4]\nlook_at = [0, 0, 0]\nfov = 40\nresolution = [24, 24]\n"


def axis(x=0.0, y=0.0):
    return AXIS.format(x=x, y=y)


def light(x, y, z):
    return f"[[lights]]\nposition = [{x}, {y}, {z}]\nintensity = [1, 1, 1]\n"


def picture(load, text, precision="double", **options):
    return render(load(text, precision), **options).numpy()


def color(load, text, **options):
    """The colour of a one-pixel image."""
    return picture(load, text, **options)[0, 0]


def gradient(scene):
    """The derivatives of the image's sum by all parameters, in one flat array."""
    params = scene.parameters()
    dr.enable_grad(params)
    dr.backward(dr.sum(render(scene.replace(params)).array))
    return np.concatenate([np.array(dr.grad(value)).ravel() for value in params.values()])


@pytest.mark.parametrize("name", SCENES)
def test_image_is_what_the_contract_says(load, name):
    # Curved surfaces magnify rounding about tenfold a bounce: 2e-16 * 1e5 stays far below 1e-9
    np.testing.assert_allclose(picture(load, SCENES[name]), Reference(SCENES[name]).image(), rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_random_scene_is_what_the_contract_says(load, seed):
    text = random_scene(seed)
    np.testing.assert_allclose(picture(load, text), Reference(text).image(), rtol=0, atol=1e-9)


def test_samples_sit_on_a_grid_and_are_averaged(load):
    text = SCENES["all"].replace("[16, 12]", "[6, 6]")
    np.testing.assert_allclose(picture(load, text, spp=9), Reference(text).image(spp=9), rtol=0, atol=1e-9)


def test_deep_image_after_a_shallow_one(load):
    """The stack of a kernel has room for the depth that is asked for now, not for that of an earlier call."""
    text = SCENES["all"].replace("[16, 12]", "[6, 6]")
    assert_same = np.testing.assert_allclose
    for depth in (2, 12, 3, 7):
        expected = Reference(f"max_depth = {depth}\n" + text).image()
        assert_same(picture(load, text, max_depth=depth), expected, rtol=0, atol=1e-9)


def test_single_precision_is_close_to_double(load):
    text = SCENES["diffuse under two lights"]
    # Away from edges, which a rounding may move across a pixel's centre, a few dozen roundings of 6e-8 add up
    error = abs(picture(load, text, "single") - picture(load, text)).max(-1)
    assert np.quantile(error, 0.97) < 1e-5


def test_index_one_is_invisible(load, precision):
    """Stress 8: where the index is 1, F is 0 and nothing bends."""
    ball = sphere([0.1, 0, 0], 0.9, "glass")
    text = "ambient = [1, 1, 1]\n" + CAMERA + CHECKS + GLASS.replace("1.5", "1.0")
    with_ball, without = (picture(load, text + b + BACKDROP, precision) for b in (ball, ""))
    # A ray restarts twice, each time from a rounded point: it may cross a checker's edge only by that much
    assert np.mean(abs(with_ball - without).max(-1) > 1e-6) <= (0.01 if precision == "single" else 0)


def test_index_one_has_finite_gradients(load, precision):
    text = "ambient = [1, 1, 1]\n" + CAMERA + CHECKS + GLASS.replace("1.5", "1.0") + sphere([0.1, 0, 0], 0.9, "glass")
    assert np.isfinite(gradient(load(text + BACKDROP, precision))).all()


@pytest.mark.parametrize("depth", [2, 3, 5, 9])
def test_furnace(load, depth):
    """Stress 15: where all radiates 1, glass shows 1 - (1 - R) R^N after N inner nodes, of which the last has a way out."""
    text = "background = [1, 1, 1]\n" + axis(math.sqrt(0.5)) + GLASS + sphere([0, 0, 0], 1, "glass")
    r = 0.05023991101223595  # at 45 degrees
    expected = 1 - (1 - r) * r ** (depth - 2)
    np.testing.assert_allclose(color(load, text, max_depth=depth), expected, rtol=1e-12)


def test_camera_at_the_center_of_a_mirror(load, precision):
    """Stress 16: the ray returns on itself, and sees the mirror again."""
    text = "ambient = [1, 1, 1]\nmax_depth = 6\n" + axis() + "[materials.m]\ncolor = [0.5, 0.5, 0.5]\nreflection = 0.5\n"
    image = picture(load, text + sphere([0, 0, 5], 2, "m"), precision)
    np.testing.assert_allclose(image, sum(0.5 * 0.5**k for k in range(6)), rtol=1e-6 if precision == "single" else 1e-14)


@pytest.mark.parametrize("depth", [1, 2, 7])
def test_facing_mirrors(load, depth):
    """Stress 17: two facing mirrors pass on reflection^k, cut exactly at the largest depth."""
    mirrors = "[materials.m]\ncolor = [1, 1, 1]\nreflection = 0.75\n" + plane([0, 0, 1], 1, "m") + plane([0, 0, -1], 6, "m")
    expected = (1 - 0.75**depth) / (1 - 0.75)
    np.testing.assert_allclose(color(load, "ambient = [1, 1, 1]\n" + axis() + mirrors, max_depth=depth), expected, rtol=1e-14)


def test_corner_of_three_mirrors_returns_the_ray(load):
    """Stress 17: out = -in."""
    planes = "".join(plane(normal, 0, "m") for normal in ([1, 0, 0], [0, 1, 0], [0, 0, 1]))
    scene = load(CAMERA + "[materials.m]\nreflection = 1\n" + planes)
    vector, number = type(scene.background), type(scene.camera.fov)
    mask, uint = dr.mask_t(number), dr.uint32_array_t(number)
    d = dr.normalize(vector(-1, -2, -1.5))
    ray = Ray(vector(3, 5, 4), d, uint(NONE), mask(False))
    for _ in range(3):
        at = surface(scene, ray, closest_hit(scene, ray))
        (mirrored,) = scatter(scene, ray, at)
        ray = Ray(at.p, mirrored.direction, at.hit.index, mirrored.inward)
    assert dr.all(closest_hit(scene, ray).index == NONE)
    np.testing.assert_allclose(np.array(ray.d), -np.array(d), atol=1e-15)


@pytest.mark.parametrize("offset", [1 - 1e-6, 1 + 1e-6])
def test_ball_in_glass_looks_larger(load, offset):
    """Stress 19: an opaque ball of radius b in the middle of glass of index n has the apparent radius n b."""
    balls = sphere([0, 0, 0], 1, "clear") + sphere([0, 0, 0], 0.4, "white")
    seen = color(load, "ambient = [1, 1, 1]\n" + axis(1.5 * 0.4 * offset) + CLEAR + WHITE + balls)
    np.testing.assert_array_equal(seen, 1 if offset < 1 else 0)


def test_ball_of_equal_index_in_glass_is_invisible(load):
    """Stress 20."""
    text = "ambient = [1, 1, 1]\nmax_depth = 9\n" + CAMERA + CHECKS + CLEAR + BACKDROP + sphere([0, 0, 0], 1, "clear")
    # A ray that restarts on the inner ball has been rounded once more
    np.testing.assert_allclose(picture(load, text + sphere([0.2, 0, 0.1], 0.5, "clear")), picture(load, text), atol=1e-12)


def test_shell_and_bubble_bend_by_the_relative_index(load):
    """Stress 20: a bubble of air in glass bends like a ball of index 1 / 1.5 in air that the ray enters in glass."""
    text = "ambient = [1, 1, 1]\n" + axis(0.3) + CLEAR + WHITE + "[materials.air]\nrefraction = 1\nior = 1\n"
    text += sphere([0, 0, 0], 1, "clear") + sphere([0, 0, 0], 0.5, "air")
    # Snell twice: 0.3 = 1.5 r sin on every shell, so that inside the bubble the ray passes the center at 0.3
    for radius, expected in (0.3 - 1e-6, 0), (0.3 + 1e-6, 1):
        np.testing.assert_array_equal(color(load, text + sphere([0, 0, 0], radius, "white")), expected)


def test_overlapping_glass_of_one_index_is_its_union(load):
    """Stress 21: only the outer surfaces reflect, whichever sphere comes first."""
    spheres = sphere([0, 0, 0], 1, "glass"), sphere([0, 0, 0.9], 0.8, "glass")
    text = "background = [1, 1, 1]\nmax_depth = 6\n" + axis() + GLASS.replace("reflection = 1", "reflection = 0")
    for order in (spheres, spheres[::-1]):
        # At normal incidence F = 0.04, once on the way in and once on the way out
        np.testing.assert_allclose(color(load, text + "".join(order)), 0.96**2, rtol=1e-14)


def test_camera_in_glass_looks_out(load):
    """Stress 22: the first surface is left, not entered, and reflects totally beyond the critical angle."""
    text = "background = [1, 1, 1]\nmax_depth = 2\n" + GLASS + sphere([0, 0, 0], 1, "glass") + AXIS.format(x=0.8, y=0)
    text = text.replace(", 5]", ", 0]").replace("look_at = [0.8, 0, 0]", "look_at = [0.8, 0, -1]")
    np.testing.assert_array_equal(color(load, text), 0)  # sin = 0.8 > 1 / 1.5: all goes on inside
    np.testing.assert_array_less(0.9, color(load, text.replace("0.8", "0.1")))


def test_light_in_glass_reaches_its_inside_only(load):
    """Stress 22: glass throws a full shadow, inwards and outwards."""
    text = axis() + WHITE + CLEAR.replace("1.5", "1.0") + sphere([0, 0, 0], 1, "clear") + light(0, 0, 0.5)
    outside = text + plane([0, 0, 1], 2, "white")
    np.testing.assert_array_equal(color(load, outside), 0)
    within = text + sphere([0, 0, 0], 0.2, "white")
    np.testing.assert_allclose(color(load, within), 1, rtol=1e-14)


@pytest.mark.parametrize(
    ("objects", "expected"),
    [
        (sphere([0, 0, 0], 1, "white") + light(0, 0, 0), 0),  # at the center: dark outside
        (sphere([0, 0, 5], 1, "white") + light(0, 0, 5), 1),  # and inside light from the front
        (sphere([0, 0, 0], 1, "white") + light(0, 0, 1), 0),  # on the surface that it would light
        (sphere([0, 0, 2], 1, "white") + light(0, 0, 1) + plane([0, 0, 1], 2, "white"), 0),
        (plane([0, 0, 1], 0, "white") + light(0, 0, 0), 0),
        (plane([0, 0, 1], 0, "white") + light(1, 0, 0), 0),  # on the plane, at grazing incidence
    ],
)
def test_light_in_strange_places(load, precision, objects, expected):
    """Stress 22 and 29: every answer is defined, and the gradient is finite."""
    text = axis() + WHITE + objects
    np.testing.assert_array_equal(picture(load, text, precision), expected)
    assert np.isfinite(gradient(load(text, precision))).all()


def test_light_on_a_sphere_shines_away_from_it(load):
    """Stress 22: the segment to a light that lies on a sphere does not cross it from outside, and does from behind."""
    text = axis(0, 0.5) + WHITE + plane([0, 0, 1], 1, "white")
    front = sphere([0, 3, 1], 1, "white") + light(0, 3, 0)
    behind = sphere([0, 3, -0.5], 0.25, "white") + light(0, 3, -0.25)
    expected = [1 / math.hypot(1, 2.5), 0]
    np.testing.assert_allclose([color(load, text + objects)[0] for objects in (front, behind)], expected, atol=1e-14)


def test_of_duplicates_the_first_decides(load, precision):
    """Stress 23: what coincides with an earlier sphere or plane cannot be seen, and shadows nothing more."""
    materials = WHITE + "[materials.red]\ncolor = [1, 0, 0]\nspecular = 1\nreflection = 0.5\n"
    ball, twin = sphere([0, 0, 0], 0.8, "red"), sphere([0, 0, 0], 0.8, "white")
    wall, twin_wall = plane([0, 1, 0.2], 1, "red"), plane([0, -1, -0.2], -1, "white")
    text = "ambient = [0.1, 0.1, 0.1]\nbackground = [0, 0, 1]\n" + CAMERA + materials + LIGHT
    alone, doubled = (picture(load, text + objects, precision) for objects in (ball + wall, ball + twin + wall + twin_wall))
    np.testing.assert_array_equal(doubled, alone)
    assert np.isfinite(gradient(load(text + ball + twin + wall + twin_wall, precision))).all()


def test_duplicate_of_glass_is_one_glass(load):
    """Stress 23: rays leave both spheres at once, with the first one's index inside."""
    text = "ambient = [1, 1, 1]\n" + CAMERA + CHECKS + GLASS + GLASS.replace("glass", "dense").replace("1.5", "2.0") + BACKDROP
    ball, twin = sphere([0, 0, 0], 0.8, "glass"), sphere([0, 0, 0], 0.8, "dense")
    np.testing.assert_array_equal(picture(load, text + ball + twin), picture(load, text + ball))


def test_touching_objects(load, precision):
    """Stress 23: spheres that touch each other and a plane, seen along the tangent plane."""
    text = "ambient = [0.5, 0.5, 0.5]\n" + CAMERA.replace("0.1, 0.2, 4", "0, 0, 4") + GLASS + WHITE + LIGHT
    text += sphere([-0.5, 0, 0], 0.5, "glass") + sphere([0.5, 0, 0], 0.5, "white") + plane([0, 1, 0], 0.5, "white")
    text = text.replace("[24, 24]", "[25, 25]")
    scene = load(text, precision)
    assert np.isfinite(render(scene).numpy()).all()
    assert np.isfinite(gradient(scene)).all()
    if precision == "double":
        # The center column looks exactly at the point of contact, where either sphere may win
        error = abs(render(scene).numpy() - Reference(text).image()).max(-1)
        assert np.delete(error, 12, axis=1).max() < 1e-9


@pytest.mark.parametrize("x", [1.0, 1 - 2**-20, 1 + 2**-20])
def test_pixel_center_on_an_edge(load, precision, x):
    """Stress 27: a ray that only just touches a sphere is defined, and so is its gradient."""
    text = "background = [0.25, 0.25, 0.25]\nambient = [1, 1, 1]\n" + axis(x) + WHITE + GLASS + LIGHT
    for material in ("white", "glass"):
        scene = load(text + sphere([0, 0, 0], 1, material) + plane([0, 0, 1], 9, "white"), precision)
        assert np.isfinite(render(scene).numpy()).all()
        assert np.isfinite(gradient(scene)).all()
    sees_ball = color(load, text + sphere([0, 0, 0], 1, "white"))[0] >= 1
    assert sees_ball == (x < 1) or x == 1


def test_empty_scene(load, precision):
    """Stress 27: a scene with nothing in it shows its background."""
    scene = load("background = [0.25, 0.5, 1]\n" + CAMERA, precision)
    np.testing.assert_array_equal(render(scene).numpy(), np.broadcast_to([0.25, 0.5, 1], (24, 24, 3)))
    names = list(scene.parameters())
    assert names == ["camera.position", "camera.look_at", "camera.fov", "background", "ambient"]
    expected = np.zeros(13)
    expected[7:10] = 24 * 24
    np.testing.assert_array_equal(gradient(scene), expected)


def test_sphere_that_covers_the_image(load):
    """Stress 27: a camera in a white ball with a light at the same place sees nothing but the ball, lit head-on."""
    text = CAMERA + WHITE + sphere([0.1, 0.2, 4], 7, "white") + light(0.1, 0.2, 4)
    np.testing.assert_allclose(picture(load, text), 1, rtol=1e-14)


def test_plane_along_the_ray_is_missed(load, precision):
    """Stress 29: a plane that contains the camera's ray, or lies parallel to it, or goes through the camera."""
    text = "background = [0.5, 0.5, 0.5]\nambient = [1, 1, 1]\n" + axis() + WHITE
    for parallel in (plane([0, 1, 0], 0, "white"), plane([0, 1, 0], 1, "white"), plane([0, 0, 1], -5, "white")):
        np.testing.assert_array_equal(picture(load, text + parallel, precision), 0.5)
        assert np.isfinite(gradient(load(text + parallel, precision))).all()
