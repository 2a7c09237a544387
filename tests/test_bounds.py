"""Pixels stay within what their samples saw, and derivatives at one sample a pixel stay bounded."""

import drjit as dr
import numpy as np
import pytest
from gradcheck import image_error
from samples import FLOOR, LIGHT, camera, keys, light, material, plane, scene, sphere, three

from whitted import gradient, load_scene, render
from whitted.edges import search, settings
from whitted.edges.bounds import cut_off
from whitted.edges.pairs import Moves

# A black and white floor to the horizon, lit evenly: every pixel is between 0 and 1
TILES = (
    keys(ambient=[1, 1, 1])
    + camera([0, 1, 0], [0, 0.5, -3], fov=60, resolution=(64, 48))
    + material("f", color=[1, 1, 1], checker={"color": [0, 0, 0], "size": 1.0})
    + plane([0, 1, 0], 0, "f")
)


def moves(pixel, moved, before, behind):
    """What edges move, each between two pixels, in grey."""
    before, behind = (np.array([values] * 3, float) for values in (before, behind))
    return Moves(np.array(pixel), np.array(moved, float), before - behind, before)


def test_pixel_is_cut_off_at_what_it_saw():
    """Pixel 0 saw 1 and 0.25, pixel 1 saw 0.25 to 0.5, and pixel 2 saw 0 to 1."""
    image = np.repeat([-0.2, 0.75, 0.5], 3)
    start = np.repeat([[1, 0.5, 0.5, 0, 0, 0]], 3, 0)
    edges = moves([[0, 1, 2], [-1, -1, -1]], np.zeros((2, 3)), [1, 0.5, 1], [0.25, 0.25, 0])
    pixels, channels = cut_off(image, start, edges, lambda pixels, own: (own, own.copy()))
    np.testing.assert_array_equal(image[::3], [0.25, 0.5, 0.5])
    np.testing.assert_array_equal(pixels, [0, 1])
    assert channels.all()


def test_rounding_cuts_off_no_derivative():
    image, start = np.full(3, 1 + 1e-9), np.ones((3, 2))
    edges = moves([[0], [-1]], np.zeros((2, 1)), [1], [0])
    pixels, _ = cut_off(image, start, edges, lambda pixels, own: (own, own.copy()))
    assert not pixels.size
    np.testing.assert_array_equal(image, 1)


@pytest.mark.parametrize("spp", [1, 4, 9])
def test_black_and_white_stays_between_black_and_white(load, precision, spp):
    loaded = load(TILES, precision)
    params = loaded.parameters("camera.position", "materials.f.checker.size")
    dr.enable_grad(params)
    image = render(loaded.replace(params), spp)
    pixels = dr.detach(image).numpy()
    assert pixels.min() >= 0
    assert pixels.max() <= 1
    assert np.isfinite(pixels ** (1 / 2.2)).all()
    dr.backward(dr.mean(image.array))
    assert all(np.isfinite(dr.grad(value).numpy()).all() for value in params.values())


@pytest.mark.parametrize("spp", [1, 4])
def test_cutting_off_makes_no_image_worse(load, monkeypatch, spp):
    loaded = load(TILES)
    reference = render(loaded, 4096, boundary=False).numpy()
    cut = image_error(render(loaded, spp).numpy(), reference)
    monkeypatch.setattr(search, "cut_off", lambda *_: None)
    assert cut <= image_error(render(loaded, spp).numpy(), reference)


def test_a_pixel_that_is_cut_off_does_not_follow_its_edges(monkeypatch):
    """In the Cornell box, where some pixels are cut off: there, the boundary term is 0."""
    loaded = load_scene("cornell").replace({"camera.resolution": (96, 96)})
    seen = {}

    def recorded(*given):
        seen["cut"] = cut_off(*given)
        return seen["cut"]

    monkeypatch.setattr(search, "cut_off", recorded)
    name = next(name for name in loaded.parameters() if name.endswith(".center"))
    slope = gradient(loaded, name, "x", terms="boundary").numpy().reshape(-1, 3)
    pixels, channels = seen["cut"]
    assert pixels.size
    assert (slope[pixels][channels.T] == 0).all()
    assert (slope != 0).any()


@pytest.mark.slow
def test_one_sample_a_pixel_tells_more_than_nothing(load):
    """Three mirrors that see each other and a chequered floor, by the place of one of them.

    An answer of 0 is wrong by 1. Were each sample to count in full, a few that lie on streaks much
    narrower than a pixel would make the answer worse than that.
    """
    chrome = material("chrome", color=[0.05] * 3, specular=0.5, shininess=60, reflection=0.8)
    tiles = {"color": [0.2, 0.2, 0.25], "size": 0.5}
    parts = (
        keys(background=[0.2, 0.3, 0.5], max_depth=6),
        camera([0.1, 0.9, 4.2], [0, 0.1, 0], fov=38, resolution=(96, 64)),
        chrome,
        material("floor", color=[0.5] * 3, reflection=0.3, checker=tiles),
        plane([0, 1, 0], 0.5, "floor"),
        sphere([-0.62, 0.02, 0.0], 0.5, "chrome"),
        sphere([0.62, 0.05, -0.2], 0.55, "chrome"),
        sphere([0.0, -0.2, 0.75], 0.28, "chrome"),
        light([-1.5, 3, 2.5], [0.9, 0.9, 0.9]),
    )
    loaded = load("".join(parts), "single")
    one, many = (gradient(loaded, "spheres.sphere0.center", "x", spp).numpy() for spp in (1, 16))
    assert image_error(one, many) < 0.7


def test_search_in_parts_is_the_search_in_one(load, monkeypatch, precision):
    """Pixels to the last bit; derivatives but for the order of sums."""
    loaded = load(scene(three("mirror", "glass", "red"), FLOOR, LIGHT), precision)
    name = "spheres.sphere0.radius"

    def computed():
        params = loaded.parameters(name)
        dr.enable_grad(params)
        reports = []
        image = render(loaded.replace(params), 4, progress=reports.append)
        dr.backward(dr.sum(image.array))
        return dr.detach(image).numpy(), params[name].grad.numpy(), reports

    whole, slope, once = computed()
    monkeypatch.setattr(settings, "SEARCHED", 400)
    image, parts, reports = computed()
    np.testing.assert_array_equal(image, whole)
    # Sums over 12 x 16 pixels in another order
    epsilon = 2.0**-23 if precision == "single" else 2.0**-52
    np.testing.assert_allclose(parts, slope, rtol=12 * 16 * 64 * epsilon)
    assert once == [1.0]
    assert len(reports) > 2
    assert reports == sorted(reports)
