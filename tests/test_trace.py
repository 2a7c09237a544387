"""The tracer against the contract's equations, and against closed forms."""

import math

import drjit as dr
import numpy as np
import pytest
from reference import ERROR, Reference
from samples import SCENES, camera, keys, light, material, plane, random_scene, sphere
from samples import render_plain as render

WHITE = material("white", color=[1, 1, 1])
CAMERA = camera([0.1, 0.2, 4], fov=40, resolution=(24, 24))


def axis(x=0.0, y=0.0):
    """A camera of one pixel at z = 5, which looks along the z axis at (x, y, 0)."""
    return camera([x, y, 5], [x, y, 0], fov=1, resolution=(1, 1))


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
    np.testing.assert_allclose(
        picture(load, SCENES[name]), Reference(SCENES[name]).image(), rtol=0, atol=ERROR
    )


@pytest.mark.parametrize("seed", range(10))
def test_random_scene_is_what_the_contract_says(load, seed):
    text = random_scene(seed)
    np.testing.assert_allclose(picture(load, text), Reference(text).image(), rtol=0, atol=ERROR)


def test_samples_sit_on_a_grid_and_are_averaged(load):
    text = SCENES["all"].replace("[16, 12]", "[6, 6]")
    np.testing.assert_allclose(
        picture(load, text, spp=9), Reference(text).image(spp=9), rtol=0, atol=ERROR
    )


def test_deep_image_after_a_shallow_one_is_right(load):
    """The stack of a kernel has room for the depth that is asked for now, not for that of an
    earlier call.
    """
    text = SCENES["all"].replace("[16, 12]", "[6, 6]")
    for depth in (2, 12, 3, 7):
        expected = Reference(f"max_depth = {depth}\n" + text).image()
        image = picture(load, text, max_depth=depth)
        np.testing.assert_allclose(image, expected, rtol=0, atol=ERROR)


def test_single_precision_is_close_to_double(load):
    text = SCENES["diffuse under two lights"]
    # 50 roundings of 6e-8; no edge of this picture is so near to a sample
    error = abs(picture(load, text, "single") - picture(load, text)).max(-1)
    assert error.max() < 3e-6


@pytest.mark.parametrize(
    ("objects", "expected"),
    [
        (sphere([0, 0, 0], 1, "white") + light([0, 0, 0]), 0),  # at the center: dark outside
        (sphere([0, 0, 5], 1, "white") + light([0, 0, 5]), 1),  # and bright inside
        (sphere([0, 0, 0], 1, "white") + light([0, 0, 1]), 0),  # at the point that it would light
        (sphere([0, 0, 2], 1, "white") + light([0, 0, 1]) + plane([0, 0, 1], 2, "white"), 0),
        (plane([0, 0, 1], 0, "white") + light([0, 0, 0]), 0),
        (plane([0, 0, 1], 0, "white") + light([1, 0, 0]), 0),  # on the plane: along it
    ],
)
def test_light_in_a_degenerate_place(load, precision, objects, expected):
    """Stress 22 and 29: the pixel is what the contract says, and the gradient is finite."""
    text = axis() + WHITE + objects
    np.testing.assert_array_equal(picture(load, text, precision), expected)
    assert np.isfinite(gradient(load(text, precision))).all()


def test_light_on_a_sphere_shines_away_from_it(load):
    """Stress 22: the segment to a light that lies on a sphere does not cross it from outside, and
    does from behind.
    """
    text = axis(0, 0.5) + WHITE + plane([0, 0, 1], 1, "white")
    front = sphere([0, 3, 1], 1, "white") + light([0, 3, 0])
    behind = sphere([0, 3, -0.5], 0.25, "white") + light([0, 3, -0.25])
    expected = [1 / math.hypot(1, 2.5), 0]
    # A few dozens of roundings
    np.testing.assert_allclose(
        [color(load, text + objects)[0] for objects in (front, behind)], expected, atol=1e-14
    )


def test_empty_scene_shows_its_background(load, precision):
    """Stress 27: a scene with nothing in it shows its background, and has derivatives by it."""
    scene = load(keys(background=[0.25, 0.5, 1]) + CAMERA, precision)
    np.testing.assert_array_equal(
        render(scene).numpy(), np.broadcast_to([0.25, 0.5, 1], (24, 24, 3))
    )
    names = list(scene.parameters())
    assert names == ["camera.position", "camera.look_at", "camera.fov", "background", "ambient"]
    expected = np.zeros(13)
    expected[7:10] = 24 * 24
    np.testing.assert_array_equal(gradient(scene), expected)
