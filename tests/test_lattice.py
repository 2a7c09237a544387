"""Pixels that share samples: with one sample a pixel, among some mirrors or much glass."""

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from gradcheck import image_error
from test_record import CENTER, RADIUS, agree, balls, gradients

import whitted as wt
from whitted.edges import kernels, settings
from whitted.edges.lattice import shares_samples
from whitted.rendering.job import BoundaryJob
from whitted.view.marks import label_edges

GLASS = {"refraction": 0.7, "reflection": 0.3, "color": (0, 0, 0), "ior": 1.3}
MATTE = {"reflection": 0}


def band_of(scene, side=1):
    size = scene.resolution
    return BoundaryJob(scene, scene.given, size, scene.max_depth, side, None).band(0, size[1])


def nine_samples(scene):
    """The samples around and in each pixel's middle: (height, width, 3, 3, channels)."""
    band, (width, height) = band_of(scene), scene.resolution
    y, x = np.meshgrid(np.arange(2 * height + 1) / 2, np.arange(2 * width + 1) / 2, indexing="ij")
    place = band.lanes(x.ravel(), y.ravel())
    color, _ = kernels.labelled_samples(*band.inputs, *place, dr.opaque(ad.Bool, False))
    seen = np.array([own.numpy()[: x.size] for own in color]).reshape(3, *x.shape)
    windows = np.lib.stride_tricks.sliding_window_view(seen, (3, 3), (1, 2))[:, ::2, ::2]
    return np.moveaxis(windows, 0, -1)


@pytest.mark.parametrize("material", [{}, GLASS])
def test_a_pixel_is_the_mean_of_the_squares_between_nine_samples(material):
    scene = balls(**material)
    image, nine = wt.render(scene).numpy(), nine_samples(scene)
    side = np.array([1, 2, 1]) / 4
    expected = np.einsum("hwijc,i,j->hwc", nine, side, side)
    shared = ~np.isclose(image, nine[..., 1, 1, :], rtol=0, atol=1e-12).all(-1)
    # Sums of nine numbers up to 2, in two orders
    np.testing.assert_allclose(image[shared], expected[shared], rtol=0, atol=1e-14)
    assert shared.mean() > 0.3


@pytest.mark.parametrize("material", [{}, GLASS])
def test_derivatives_agree_in_both_modes(material):
    *one_by_one, along = gradients(balls(**material), (CENTER, RADIUS))
    size = sum(np.abs(own).sum() for own in one_by_one)
    # Sums of as many products in another order
    assert sum(own.sum() for own in one_by_one) == pytest.approx(along, rel=0, abs=1e-11 * size)


def test_an_image_in_bands_is_the_image():
    scene = balls(precision="single")
    whole = wt.render(scene).numpy()
    parts = [wt.render(scene, rows=rows).numpy() for rows in ((0, 7), (7, 1), (8, 12))]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_pixels_in_parts_are_the_same_pixels(monkeypatch):
    """Where two parts meet, each does its own half of the edges that they share."""
    scene = balls()
    whole, image = gradients(scene, (CENTER, RADIUS)), wt.render(scene).numpy()
    monkeypatch.setattr(settings, "SAMPLES", 4 * 50)
    np.testing.assert_array_equal(wt.render(scene).numpy(), image)
    agree(gradients(scene, (CENTER, RADIUS)), whole, 1e-11)


def along(scene, step, spp):
    """The derivative of the image as the centers move."""
    values = scene.parameters(CENTER)
    dr.enable_grad(values)
    image = wt.render(scene.replace(values), spp)
    dr.set_grad(values[CENTER], type(values[CENTER])(step))
    return dr.forward_to(image).numpy()


def differences(scene, step, h):
    """The same from images of 1024 samples a pixel."""
    start = scene.parameters(CENTER)[CENTER]
    moved = (scene.replace({CENTER: type(start)(np.array(start) + s * step)}) for s in (h, -h))
    ahead, back = (wt.render(own, 1024, boundary=False).numpy() for own in moved)
    return (ahead - back) / (2 * h)


def random_step(scene):
    return np.random.default_rng(2).uniform(-1, 1, np.shape(scene.parameters(CENTER)[CENTER]))


def test_derivatives_come_closer_with_the_samples():
    scene = balls().replace({"max_depth": 2, "camera.resolution": (48, 40)})
    step = random_step(scene)
    sharp = along(scene, step, 64)
    errors = [image_error(along(scene, step, spp), sharp) for spp in (1, 4, 16)]
    # An answer of 0 is off by 1
    assert errors[2] < errors[1] < errors[0] < 0.8, errors


@pytest.mark.parametrize("spp", [1, 4])
def test_derivatives_among_mirrors_have_no_spikes(spp):
    """Those of a search for edges are off by 5 and 42 here, since single samples have huge ones."""
    scene = balls(60, reflection=0.9).replace({"max_depth": 5, "camera.resolution": (48, 40)})
    step = random_step(scene)
    expected = differences(scene, step, 1e-3)
    error = np.linalg.norm(along(scene, step, spp) - expected) / np.linalg.norm(expected)
    # An answer of 0 is off by 1
    assert error < 0.8, error


@pytest.mark.parametrize(
    ("count", "material", "side", "shares"),
    [
        (settings.MOST_MIRRORS, {}, 1, False),
        (settings.MOST_MIRRORS + 1, {}, 1, True),
        (settings.MOST_MIRRORS + 1, {}, 2, False),
        (settings.MOST_SEARCHED, GLASS, 1, False),
        (settings.MOST_SEARCHED + 1, GLASS, 1, True),
        (settings.MOST_SEARCHED + 1, MATTE, 1, False),
    ],
)
def test_pixels_share_samples_among_some_mirrors_or_much_glass(count, material, side, shares):
    assert shares_samples(band_of(balls(count, **material), side)) == shares


def test_edges_of_labels_are_shown_among_many_spheres():
    """The page marks them; the kernel's images are two there."""
    scene = balls()
    marked = label_edges(scene, scene.resolution, scene.max_depth).numpy()
    assert 0 < np.count_nonzero(marked) < marked.size
