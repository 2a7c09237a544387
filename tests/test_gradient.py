"""The derivative of an image by one number: of the right parameter, of the right component, in the
right type.
"""

import drjit as dr
import numpy as np
import pytest
from gradcheck import SUM, as_type, jvp
from samples import SCENES, keys, scene, sphere

from whitted.rendering.api import render
from whitted.rendering.gradient import gradient

# One matte ball in a light of its own that comes from everywhere, before a black sky
BALL = scene(sphere([0, 0, 0], 0.7, "red"), sky=keys(background=[0, 0, 0], ambient=[0.2, 0.3, 0.4]))
ALBEDO = np.array([0.8, 0.2, 0.1])


@pytest.mark.parametrize("component", ["x", "y", "z"])
def test_ambient_light_has_its_closed_form(load, component):
    """Ambient light times albedo: the derivative by one channel is that channel's albedo where the
    ball is.
    """
    ball = load(BALL)
    image = gradient(ball, "ambient", component, boundary=False).numpy()
    channel = "xyz".index(component)
    seen = render(ball, boundary=False).numpy()[..., channel] > 0
    assert 0.05 < seen.mean() < 0.95
    np.testing.assert_array_equal(image[..., channel], ALBEDO[channel] * seen)
    assert not np.delete(image, channel, axis=-1).any()


def test_moving_ball_darkens_behind_and_brightens_before(load):
    """The boundary term of a motion to the right: nothing inside, red on the right edge and blue on
    the left one.
    """
    image = (
        gradient(
            load(BALL), "spheres.sphere0.center", "x", 4, terms="boundary", resolution=(32, 24)
        )
        .numpy()
        .mean(-1)
    )
    assert image[:, :13].max() <= 0 > image[:, :13].min()
    assert image[:, 19:].min() >= 0 < image[:, 19:].max()
    assert not image[10:14, 14:18].any()


@pytest.mark.parametrize(
    ("name", "component", "tangent"),
    [
        ("camera.fov", None, [1]),
        ("spheres.sphere0.radius", None, [1]),
        ("lights.light0.position", "z", [0, 0, 1]),
    ],
)
def test_gradient_is_forward_mode_by_one_number(load, precision, name, component, tangent):
    room = load(SCENES["all"], precision)
    options = {"spp": 4, "boundary": False, "max_depth": 3, "resolution": (8, 6)}
    image = gradient(room, name, component, **options)
    expected = jvp(
        lambda values: render(room.replace(values), **options),
        room.parameters(name),
        {name: tangent},
    )
    assert type(image) is type(render(room, **options))
    assert not dr.grad_enabled(image)
    assert abs(expected).max() > 0
    np.testing.assert_array_equal(image.numpy(), expected)


@pytest.mark.parametrize("weight", [0, 0.01])
def test_a_small_weight_counts_up_to_the_silhouette(load, weight):
    """The derivative by a reflection is what is seen in it: here a sky of 1, wherever the ball is.

    Of the weight 0, for which edges are not found, a pixel has 64 samples; of 0.01 it has edges.
    """
    text = BALL.replace("background = [0, 0, 0]", "background = [1, 1, 1]")
    ball = load(text).replace({"materials.red.reflection": weight})
    image, samples = (
        gradient(ball, "materials.red.reflection", None, spp, boundary=spp == 16).numpy()
        for spp in (16, 1024)
    )
    # The part of a pixel that is on the ball: an edge along a row of 8 x 8 samples may be off by
    # half a row
    assert abs(image - samples).max() < 1 / 16
    # In 20 pixels on the edge the errors are about 0.01 of either sign, 0.05 of 26 in all
    assert abs(image.sum() / samples.sum() - 1) < 2e-3


def test_a_weight_too_small_for_edges_has_four_times_the_samples(load):
    room = load(SCENES["all"]).replace({"materials.mirror.reflection": 0.02})
    edges, samples = (
        gradient(
            room, "materials.mirror.reflection", None, spp, boundary=spp == 4, resolution=(16, 12)
        ).numpy()
        for spp in (4, 16)
    )
    np.testing.assert_array_equal(edges, samples)
    # And of 0.02, not of more, are edges left out
    other = gradient(room, "materials.mirror.reflection", None, 16, resolution=(16, 12)).numpy()
    assert abs(other - samples).max() > 1e-3 * abs(samples).max()


def test_terms_add_up(load):
    room = load(SCENES["all"])
    options = {"max_depth": 2, "resolution": (16, 12)}
    both, interior, boundary = (
        gradient(room, "spheres.sphere0.radius", terms=terms, **options).numpy()
        for terms in ("both", "interior", "boundary")
    )
    assert min(abs(interior).max(), abs(boundary).max()) > 0.01
    # The same terms in another order
    np.testing.assert_allclose(interior + boundary, both, rtol=0, atol=SUM * abs(both).max())


def test_gradients_that_the_scene_carries_stay_out_of_it(load):
    ball = load(BALL)
    ambient = ball.parameters("ambient")
    dr.enable_grad(ambient)
    dr.set_grad(ambient["ambient"], as_type(ambient["ambient"], [5, 5, 5]))
    image = gradient(ball.replace(ambient), "ambient", "y", boundary=False)
    np.testing.assert_array_equal(
        image.numpy(), gradient(ball, "ambient", "y", boundary=False).numpy()
    )
    np.testing.assert_array_equal(np.ravel(dr.grad(ambient["ambient"]).numpy()), [5, 5, 5])


def test_progress_counts_to_one_once(load):
    seen = []
    gradient(load(BALL), "camera.fov", boundary=False, progress=seen.append)
    assert seen == [0.5, 1.0]


@pytest.mark.parametrize("component", [None, "", "w", "xy", "X"])
def test_vector_needs_a_component(load, component):
    message = (
        r"^component: expected x, y or z \(for red, green or blue of a colour\) "
        rf"for the vector 'ambient', got {component or 'none'}$"
    )
    with pytest.raises(ValueError, match=message):
        gradient(load(BALL), "ambient", component)


def test_number_has_no_component(load):
    with pytest.raises(
        ValueError, match=r"^component: expected none for the number 'camera\.fov', got x$"
    ):
        gradient(load(BALL), "camera.fov", "x")


def test_unknown_names_and_bad_arguments_of_render_are_refused(load):
    with pytest.raises(
        KeyError, match=r"the scene has no parameter 'camera\.fow'; nearest: camera\.fov"
    ):
        gradient(load(BALL), "camera.fow")
    with pytest.raises(
        ValueError,
        match=r"^name: 'camera\.\*' stands for camera\.position, camera\.look_at, camera\.fov; ",
    ):
        gradient(load(BALL), "camera.*")
    with pytest.raises(ValueError, match=r"^spp: expected a perfect square"):
        gradient(load(BALL), "camera.fov", spp=3)
