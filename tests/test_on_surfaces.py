"""Eyes and lights exactly on a surface: on a sphere they are outside of it, on a plane they are on
neither side.

"Exactly" is meant for the numbers as they are stored, or for the decimals that they stand for:
-0.65 + 0.35 is -0.3, although no binary numbers of these names add up to that.
"""

import drjit as dr
import numpy as np
import pytest
from samples import camera, light, material, plane, scene, sphere

import whitted as wt

MATTE = material("m", color=(0.8, 0.6, 0.4), specular=0.4)
GROUND = material("g", color=(0.6, 0.5, 0.3))
BACKGROUND = np.array([0.3, 0.5, 0.9])  # of all scenes of `samples`
LAMP = light((20, 30, 20))


def ground(eye, look_at, center=(0, -1000, 0), radius=1000):
    view = camera(eye, look_at, fov=40, resolution=(32, 32))
    return scene(GROUND, sphere(center, radius, "g"), LAMP, camera=view)


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize(
    ("center", "radius", "eye"),
    [
        ((0, -1000, 0), 1000, (0, 0, 0)),
        ((0.45, -0.65, 0.2), 0.35, (0.45, -0.3, 0.2)),
        ((0.1, -0.7, 0.3), 0.65, (0.1, -0.05, 0.3)),
    ],
    ids=["exact", "inside by rounding", "outside by rounding"],
)
def test_eye_on_a_sphere_is_outside_of_it(load, precision, center, radius, eye):
    """All that is below the horizontal is ground: rows from 12 on, of 32 that look down by 1/10.

    A row's border that lies on the horizon is at 16 - 16 (1/10) / tan(20 deg) = 11.604.
    """
    x, y, z = eye
    look_at = x, y - 1, z - 10
    found = load(ground(eye, look_at, center, radius), precision)
    image = wt.render(found, boundary=False).numpy()
    assert np.isfinite(image).all()
    is_sky = abs(image - BACKGROUND).max(-1) < 1e-3
    assert is_sky[:12].all()
    assert not is_sky[12:].any()


def test_horizon_moves_with_the_view_of_an_eye_on_the_ground(load):
    """Against central differences of 256 samples a pixel, in the row that the horizon crosses."""
    start = load(ground((0, 0, 0), (0, -1, -10)))
    name = "camera.look_at"

    def column(y):
        return wt.render(start.replace({name: (0, y, -10)}), 256, boundary=False).numpy()[:, 16]

    values = start.parameters(name)
    dr.enable_grad(values)
    dr.set_grad(values[name], type(values[name])(0, 1, 0))
    image = wt.render(start.replace(values), 4)
    slope = dr.forward_to(image).numpy()[:, 16]
    # The horizon passes half a row, so that 16 rows of samples tell its slope to 1 in 8
    step = 0.5 * np.tan(np.radians(20)) / 16 * 10
    expected = (column(-1 + step) - column(-1 - step)) / (2 * step)
    assert abs(expected).max() > 1
    assert np.linalg.norm(slope.sum(0) - expected.sum(0)) < np.linalg.norm(expected.sum(0)) / 8


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("normal", [(0, 1, 0), (0.6, 0.8, 0), (0.3, 1, 0.2)])
def test_plane_through_the_eye_and_the_light_is_as_none(load, precision, normal):
    """It is not seen, and keeps no light away from a ball on both sides of it."""
    n = np.array(normal) / np.linalg.norm(normal)
    along = np.cross(n, (0.2, 0.1, 1))
    eye, lamp = np.array([0.1, 0.2, 4.0]), np.array([0.1, 0.2, 4.0]) + 3 * along
    ball = sphere((0.1, 0.2, 0), 1, "m")
    view = camera(tuple(eye), (0.1, 0.2, 0), resolution=(24, 24))
    parts = MATTE, ball, light(tuple(lamp))
    wall = plane(normal, -float(n @ eye), "m")
    alone = wt.render(load(scene(*parts, camera=view), precision), boundary=False)
    image = wt.render(load(scene(*parts, wall, camera=view), precision), boundary=False)
    np.testing.assert_array_equal(image.numpy(), alone.numpy())


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("spot", [(0, 1, 0), (0.6, 0.8, 0), (0.48, 0.6, 0.64)])
def test_light_on_a_sphere_is_outside_of_it(load, precision, spot):
    """It lights a wall as a light just above the sphere does.

    The light moves by 1e-3 of its distance from the wall, and the horizon that the sphere makes for
    it by sqrt(2e-3) of a right angle, 3 %. So at most that part of the wall differs much.
    """
    center = np.array([0.3, -0.1, 0.2])

    def image(height):
        lamp = center + (1 + height) * 0.5 * np.array(spot)
        parts = MATTE, sphere(tuple(center), 0.5, "m"), plane((0, 0, 1), 2, "m"), light(tuple(lamp))
        found = load(scene(*parts, camera=camera((0, 1, 5), resolution=(32, 32))), precision)
        return wt.render(found, boundary=False).numpy()

    on, above = image(0.0), image(1e-3)
    assert np.mean(abs(on - above).max(-1) > 0.02) < 0.05
    assert np.mean(on.max(-1) > 0.1) > 0.2


@pytest.mark.parametrize("precision", ["single", "double"])
def test_light_in_a_tilted_plane_grazes_it(load, precision):
    """n . l is 0 there. Rounding would give it either sign, and with it highlights in half of the
    pixels.
    """
    n = np.array([0.3, 1, 0.2]) / np.linalg.norm([0.3, 1, 0.2])
    lamp = tuple(3 * np.cross(n, (0, 0, 1)) - 0.7 * n)
    parts = MATTE, plane(tuple(n), 0.7, "m"), light(lamp)
    found = load(scene(*parts, camera=camera((0, 1, 4), resolution=(32, 32))), precision)
    image = wt.render(found.replace({"ambient": (0, 0, 0)}), boundary=False).numpy()
    floor = image[16:].reshape(-1, 3)
    assert (floor == floor[0]).all()
