"""`render(rows=)`: a band of the image is the same rows of the whole image, to the last bit."""

import re

import drjit as dr
import numpy as np
import pytest
from samples import EPSILON, SCENES

import whitted as wt

SIZE = (20, 19)
# One row; a few at the top, in the middle and at the bottom; no multiple of the 4 x 4 blocks
BANDS = [(0, 3), (3, 1), (5, 9), (13, 6)]
# A partition, whose borders are no multiples of 4 either
PARTS = [(0, 6), (6, 1), (7, 12)]


def cloud(precision, spheres):
    """Checkers behind many spheres, which are found by a tree; above 256 all pixels are crowds."""
    rng = np.random.default_rng(3)
    rows = np.column_stack([rng.uniform(-1, 1, (spheres, 3)), rng.uniform(0.05, 0.15, spheres)])
    glass = wt.Material("glass", reflection=1, refraction=1, ior=1.4, fresnel=True)
    white = wt.Material(
        "white", color=(0.8,) * 3, checker=wt.Checkerboard(color=(0,) * 3, size=0.3)
    )
    return wt.Scene(
        camera=wt.Camera(position=(0, 1.2, 4.5), look_at=(0, 0, 0), fov=40, resolution=SIZE),
        clouds=[wt.Cloud("beads", spheres=rows, material=glass)],
        planes=[wt.Plane("floor", normal=(0, 1, 0), offset=1, material=white)],
        lights=[wt.PointLight("key", position=(1, 3, 2), intensity=(1, 1, 1))],
        max_depth=3,
        precision=precision,
    )


def assert_rows_are_those_of_the_whole(scene, spp, boundary=True, bands=BANDS, size=SIZE):
    options = {"boundary": boundary, "resolution": size}
    whole = wt.render(scene, spp, **options).numpy()
    for first, count in bands:
        band = wt.render(scene, spp, rows=(first, count), **options).numpy()
        assert band.shape == (count, size[0], 3)
        np.testing.assert_array_equal(band, whole[first : first + count], err_msg=f"{first}")


@pytest.mark.parametrize(
    ("name", "spp"),
    [
        *((name, spp) for name in ("cornell", "whitted1980", "nested") for spp in (1, 4, 9)),
        # Crowds are searched for their edges; that takes long where they are many
        ("cornell", 25),
        ("nested", 25),
    ],
)
def test_rows_of_shipped_scenes(precision, name, spp):
    """Mirrors, glass in glass, checkers to the horizon, and crowds of edges in all of them."""
    scene = wt.load_scene(name, precision)
    for boundary in (True, False):
        assert_rows_are_those_of_the_whole(scene, spp, boundary)


@pytest.mark.parametrize("spheres", [40, 300])
@pytest.mark.parametrize("spp", [1, 9])
def test_rows_of_clouds(precision, spheres, spp):
    assert_rows_are_those_of_the_whole(cloud(precision, spheres), spp)


@pytest.mark.parametrize(
    "name", ["panes", "overlapping glass", "partial shadows on each other", "checkers on all axes"]
)
def test_rows_of_small_scenes(load, precision, name):
    scene = load(SCENES[name], precision)
    assert_rows_are_those_of_the_whole(scene, 4, bands=[(4, 3), (10, 9)])


def test_rows_far_down_a_large_image():
    """Positions are those of the whole image, though rounding is coarse there.

    Each row is compared with itself within more rows, as the whole image would take long.
    """
    scene = wt.load_scene("cornell")
    size = (8, 1 << 20)
    more = wt.render(scene, 9, resolution=size, rows=((1 << 19) + 1, 7)).numpy()
    one = wt.render(scene, 9, resolution=size, rows=((1 << 19) + 4, 1)).numpy()
    np.testing.assert_array_equal(one, more[3:4])
    last = wt.render(scene, resolution=size, rows=((1 << 20) - 1, 1))
    assert last.shape == (1, 8, 3)


def test_the_whole_image_as_rows(load):
    scene = load(SCENES["all"])
    whole = wt.render(scene, 4)
    np.testing.assert_array_equal(wt.render(scene, 4, rows=(0, 12)).numpy(), whole.numpy())
    # Of NumPy and in a list, as `resolution` may be
    assert wt.render(scene, rows=[np.int64(2), 3]).shape == (3, 16, 3)


NAMES = ["spheres.sphere0.center", "spheres.sphere0.radius", "materials.glass.ior", "camera.fov"]


def derivatives(scene, spp, boundary, weight, rows=None):
    """The image; its tangent along all of NAMES; and the gradient of its weighted sum."""
    values = scene.parameters(*NAMES)
    dr.enable_grad(values)
    options = {"boundary": boundary, "resolution": SIZE, "rows": rows}
    image = wt.render(scene.replace(values), spp, **options)
    first, count = rows or (0, SIZE[1])
    seed = weight[first : first + count]
    dr.backward(dr.sum(image * type(image)(np.ascontiguousarray(seed)), axis=None))
    gradient = np.concatenate([dr.grad(value).numpy().ravel() for value in values.values()])
    moving = scene.parameters(*NAMES)
    dr.enable_grad(moving)
    dr.set_grad(moving, {name: type(value)(1) for name, value in moving.items()})
    tangent = dr.forward_to(wt.render(scene.replace(moving), spp, **options)).numpy()
    return tangent, gradient


@pytest.mark.parametrize("boundary", [True, False])
@pytest.mark.parametrize("spp", [1, 9, 16])
def test_derivatives_of_bands_add_up(load, precision, spp, boundary):
    """Of all samples and edges each is in one band, so that only the order of sums differs."""
    scene = load(SCENES["all"], precision)
    weight = np.random.default_rng(1).uniform(0.5, 1, (SIZE[1], SIZE[0], 3))
    weight = weight.astype(scene.precision.dtype)
    tangent, gradient = derivatives(scene, spp, boundary, weight)
    parts = [derivatives(scene, spp, boundary, weight, rows) for rows in PARTS]
    total = sum(part for _, part in parts)
    # Sums of some 10^4 terms of both signs, the largest of which are a few times the largest sum.
    # Their roundings are of random sign; a pixel's tangent has far fewer
    tolerance = 100 * EPSILON[precision] * abs(gradient).max()
    np.testing.assert_allclose(total, gradient, rtol=0, atol=tolerance)
    whole = np.concatenate([part for part, _ in parts])
    tolerance = 100 * EPSILON[precision] * abs(tangent).max()
    np.testing.assert_allclose(whole, tangent, rtol=0, atol=tolerance)


def test_derivatives_by_spheres_of_a_cloud_add_up():
    scene = cloud("double", 40)

    def gradient(rows=None):
        values = scene.parameters("clouds.beads.radius")
        dr.enable_grad(values)
        dr.backward(dr.sum(wt.render(scene.replace(values), 4, rows=rows), axis=None))
        return dr.grad(values["clouds.beads.radius"]).numpy()

    whole = gradient()
    # As above
    tolerance = 100 * EPSILON["double"] * abs(whole).max()
    np.testing.assert_allclose(sum(map(gradient, PARTS)), whole, rtol=0, atol=tolerance)


def test_progress_of_rows_ends_at_one(load, monkeypatch):
    monkeypatch.setattr("whitted.rendering.job.BAND", 16 * 4)
    done = []
    wt.render(load(SCENES["all"]), boundary=False, rows=(2, 10), progress=done.append)
    np.testing.assert_allclose(done, [0.4, 0.8, 1])


@pytest.mark.parametrize(
    "rows",
    [(0, 0), (-1, 2), (12, 1), (11, 2), (0, 13), (0,), 3, "02", (0.0, 1), (True, 1), (0, 1, 2)],
)
def test_rows_that_the_image_has_not_are_refused(load, rows):
    message = (
        f"rows: expected (first, count), two whole numbers within the rows 0 to 11, got {rows!r}"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        wt.render(load(SCENES["all"]), rows=rows)


def test_rows_are_not_given_with_error(load):
    message = "rows: error may choose other samples for each band; give spp in place of error"
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        wt.render(load(SCENES["all"]), error=0.1, rows=(0, 4))


def test_only_the_rows_have_to_fit_in_memory():
    """A picture of 10^12 pixels, of which one row is asked for."""
    scene = wt.load_scene("cornell")
    size = (1 << 20, 1 << 20)
    with pytest.raises(ValueError, match=r"^resolution: an image of 1048576 x 1048576 takes"):
        wt.render(scene, resolution=size)
    message = r"^resolution: an image of 1048576 x 1000000 takes .* too much; use a smaller one"
    with pytest.raises(ValueError, match=message):
        wt.render(scene, resolution=size, rows=(5, 1000000))
    assert wt.render(scene, resolution=(1 << 10, 1 << 20), rows=(1 << 19, 1)).shape == (1, 1024, 3)
