"""Settings chosen for an error: met by the image, refused where they cannot be."""

import re

import drjit as dr
import numpy as np
import pytest
from samples import CAMERA, MATERIALS, SKY, keys, sphere

import whitted as wt
from whitted.rendering.auto_samples import Setting, recommend, settings
from whitted.rendering.samples import render_samples

BALLS = (
    SKY
    + keys(max_depth=1)
    + CAMERA
    + MATERIALS
    + sphere([0, 0, 0], 0.9, "red")
    + sphere([1, 0.5, -1], 0.8, "veil")
)


@pytest.fixture(scope="module")
def balls(tmp_path_factory):
    path = tmp_path_factory.mktemp("accuracy") / "scene.toml"
    path.write_text(BALLS)
    return wt.load_scene(path)


@pytest.mark.parametrize("error", [0.05, 0.02, 0.005])
def test_error_that_is_asked_for_is_met(balls, error):
    resolution = (160, 120)
    reference = wt.render(balls, 1024, boundary=False, resolution=resolution).numpy()
    image = wt.render(balls, error=error, resolution=resolution).numpy()
    assert np.sqrt(np.mean((image - reference) ** 2)) <= error * np.sqrt(np.mean(reference**2))


def test_the_cheapest_good_setting_is_taken(balls, monkeypatch):
    offered = [Setting(4, True, 3.0), Setting(1, False, 1.0), Setting(16, False, 2.0)]
    monkeypatch.setattr("whitted.rendering.auto_samples.settings", lambda *_: offered)
    size = (160, 120)
    assert recommend(balls, 0.5, resolution=size) == offered[1]
    assert recommend(balls, 0.02, resolution=size) == offered[2]
    assert recommend(balls, 0.002, resolution=size) == offered[0]
    with pytest.raises(ValueError, match=r"1e-06 is below what is tried") as refused:
        recommend(balls, 1e-6, resolution=size)
    (least,) = re.findall(r"about (\S+) is the least for this scene", str(refused.value))
    # It is of a reference of its own, whose error is as large at most
    reference = wt.render(balls, 4096, boundary=False, resolution=size).numpy()
    image = wt.render(balls, 4, resolution=size).numpy()
    error = np.sqrt(np.mean((image - reference) ** 2) / np.mean(reference**2))
    assert error / 2 < float(least) < 2 * error
    expected = wt.render(balls, 16, boundary=False, resolution=size).numpy()
    np.testing.assert_array_equal(wt.render(balls, error=0.02, resolution=size).numpy(), expected)


def test_reference_has_plain_samples_where_edges_take_long(balls, monkeypatch):
    """Then the settings with edges, which cost more than one that is good enough, are not tried."""
    offered = [
        Setting(1, False, 1.0),
        Setting(16, False, 2.0),
        Setting(1, True, 3.0),
        Setting(4, True, 2000.0),
    ]
    monkeypatch.setattr("whitted.rendering.auto_samples.settings", lambda *_: offered)
    tried = []
    monkeypatch.setattr(
        "whitted.rendering.auto_samples.render_samples",
        lambda *args, **options: tried.append(args[1]) or render_samples(*args, **options),
    )
    assert recommend(balls, 0.02, resolution=(160, 120)) == offered[1]
    assert tried == [1024, 1, 16]


def test_costs_of_larger_images_are_told_from_small_ones(balls, monkeypatch):
    """Costs are measured at 128 x 128 pixels. Sixteen times as many take sixteen times as long, but
    their edges, of four times the length, only four times.
    """
    # Milliseconds at 128 x 128 pixels: 1 for a plain sample a pixel; with edges 1.2, and 3 for the
    # edges
    monkeypatch.setattr(
        "whitted.rendering.auto_samples._seconds",
        lambda call: (
            call.args[1]
            * (4.2e-3 if call.keywords["boundary"] else 1e-3)
            * (call.keywords["resolution"] == (128, 128))
        ),
    )
    small, large = (settings(balls, None, (side, side)) for side in (128, 512))
    assert {(one.spp, one.boundary) for one in small} == {(one.spp, one.boundary) for one in large}
    assert len(small) == 10
    for one, other in zip(small, large, strict=True):
        ms = one.spp * 1e-3
        # Sums and products of a few numbers
        small_cost, large_cost = (4.2, 16 * 1.2 + 4 * 3) if one.boundary else (1, 16)
        assert one.cost == pytest.approx(small_cost * ms, rel=1e-12)
        assert other.cost == pytest.approx(large_cost * ms, rel=1e-12)


def test_gradients_pass_through_an_image_of_a_chosen_setting(balls):
    values = balls.parameters("ambient")
    dr.enable_grad(values)
    dr.backward(
        dr.mean(wt.render(balls.replace(values), error=0.05, resolution=(16, 12)), axis=None)
    )
    assert np.all(values["ambient"].grad.numpy() > 0)


@pytest.mark.parametrize("error", [0, -1, float("nan"), float("inf"), "small"])
def test_error_that_is_not_above_zero_is_refused(balls, error):
    with pytest.raises(ValueError, match="expected a relative error above 0"):
        wt.render(balls, error=error)


@pytest.mark.parametrize("also", [{"spp": 4}, {"boundary": False}])
def test_error_and_a_setting_of_ones_own_exclude_each_other(balls, also):
    with pytest.raises(ValueError, match=f"chooses {next(iter(also))} itself"):
        wt.render(balls, error=0.1, **also)


def test_error_and_terms_exclude_each_other(balls):
    """Plain samples, which it may choose, have no terms."""
    message = r"error: may choose boundary=False, which has no terms='interior'; leave terms out"
    for image in (wt.render, lambda scene, **more: wt.gradient(scene, "camera.fov", **more)):
        with pytest.raises(ValueError, match=message):
            image(balls, error=0.1, terms="interior")
