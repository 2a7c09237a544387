"""`pick`: the shape at a place of the picture, also in mirrors."""

import drjit as dr
import numpy as np
import pytest
from view_scene import TEXT

import whitted as wt
from whitted.core.ray import NONE
from whitted.rendering.pick import indices


@pytest.fixture(scope="module")
def scene():
    return wt.parse_scene(TEXT)


def seen_at(scene, point):
    """Where a point is seen, in pixels, by the equations of the contract."""
    x, y, z = point
    eye = np.array(scene.numbers["camera.position"])
    half = (eye[2] - z) * np.tan(np.radians(scene.numbers["camera.fov"][0]) / 2)
    width, height = scene.resolution
    return width / 2 * (1 + x / half * height / width), height / 2 * (1 - y / half)


def test_front_of_a_sphere(scene):
    """Seen from (0, 0, 4), the ray through its centre meets it a radius before that."""
    found = wt.pick(scene, *seen_at(scene, (0.6, 0, 0.5)))
    assert found.name == "spheres.ball"
    away = np.hypot(0.6, 3.5)
    assert found.distance == pytest.approx(away - 0.4, rel=1e-6)
    expected = np.array([0, 0, 4]) + (1 - 0.4 / away) * np.array([0.6, 0, -3.5])
    np.testing.assert_allclose(found.point, expected, atol=1e-6)


def test_gradients_of_a_scene_do_not_matter(scene):
    values = scene.parameters("spheres.ball.center", "camera.position")
    dr.enable_grad(values)
    place = seen_at(scene, (0.6, 0, 0.5))
    assert wt.pick(scene.replace(values), *place, through=True) == wt.pick(scene, *place)


def test_background_is_nothing(scene):
    assert wt.pick(scene, 24, 1) is None


def test_a_mirror_is_itself_or_what_is_seen_in_it(scene):
    """The ball's mirror image: the centre reflected at the disc's plane."""
    n = np.array([0.35, 0, 1]) / np.hypot(0.35, 1)
    center, foot = np.array([0.6, 0, 0.5]), np.array([-0.6, 0, -0.5])
    image = center - 2 * ((center - foot) @ n) * n
    place = seen_at(scene, image)
    assert wt.pick(scene, *place).name == "discs.mirror"
    through = wt.pick(scene, *place, through=True)
    assert through.name == "spheres.ball"
    # As far as the image's front
    assert through.distance == pytest.approx(np.hypot(image[0], image[2] - 4) - 0.4, rel=1e-4)
    assert np.linalg.norm(np.subtract(through.point, center)) == pytest.approx(0.4, rel=1e-5)


def test_a_matte_surface_is_not_looked_through(scene):
    place = seen_at(scene, (0.6, 0, 0.5))
    assert wt.pick(scene, *place, through=True) == wt.pick(scene, *place)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_numbers_of_all_pixels_are_those_of_each(scene, precision):
    scene, size = scene.astype(precision), (12, 8)
    numbers = indices(scene, size).numpy().reshape(8, 12)
    assert len(np.unique(numbers)) >= 3
    for y, row in enumerate(numbers):
        for x, number in enumerate(row):
            found = wt.pick(scene, x + 0.5, y + 0.5, resolution=size)
            shape = None if number == NONE else scene.shapes[number]
            assert (found and found.name) == (shape and f"{shape.group}.{shape.name}")


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ((-1, 0), "x: expected pixels from 0 to 48, got -1"),
        ((0, 33), "y: expected pixels from 0 to 32, got 33"),
        ((float("nan"), 0), "x: expected pixels from 0 to 48, got nan"),
        (("a", 0), "x: expected pixels from 0 to 48, got 'a'"),
    ],
)
def test_bad_places(scene, place, message):
    with pytest.raises(ValueError, match=message):
        wt.pick(scene, *place)


def test_other_bad_arguments(scene):
    with pytest.raises(TypeError, match="expected a Scene, got 'cornell'"):
        wt.pick("cornell", 1, 1)
    with pytest.raises(ValueError, match="resolution: expected"):
        wt.pick(scene, 1, 1, resolution=(0, 1))
