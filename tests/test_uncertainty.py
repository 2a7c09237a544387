"""Error bars hold what they say, also without noise; what a picture does not tell is named."""

import numpy as np
import pytest
from samples import camera, keys, light, material, sphere

import whitted as wt
from whitted.inverse.uncertainty import direction

CENTER, RADIUS = "spheres.ball.center", "spheres.ball.radius"
BALL = (
    keys(background=[0.1, 0.2, 0.3], ambient=[0.3, 0.3, 0.3], max_depth=1)
    + camera([0, 0, 4], [0, 0, 0], 50, (48, 48))
    + material("red", color=[0.8, 0.3, 0.1])
    + sphere([0.2, -0.1, 0], 0.8, "red", name="ball")
    + light([2, 2, 4], [0.6, 0.6, 0.6])
)


@pytest.fixture
def ball(load):
    return load(BALL, "single")


def test_error_bars_of_samples_alone(ball):
    """Errors of a fit to pictures without noise, which have 16 samples where the fit has 4.

    In units of the bars their mean square is 1, and that of 12 pictures of 4 numbers, if only the
    pictures are independent, is off by sqrt(2 / 12); four of that. If the residual were taken for
    noise that is alike in all pixels, it would be 30.
    """
    random, scores = np.random.default_rng(5), []
    for _ in range(12):
        center = random.uniform(-0.1, 0.1, 3)
        truth = ball.replace({CENTER: center, RADIUS: random.uniform(0.7, 0.9)})
        found = wt.fit(ball, wt.render(truth, 16), wrt=[CENTER, RADIUS], levels=1)
        errors = [*(found.parameters[CENTER] - center)]
        errors.append(found.parameters[RADIUS] - truth.parameters(RADIUS)[RADIUS].numpy()[0])
        scores.extend(np.array(errors) / np.sqrt(found.covariance.diagonal()))
    assert abs(np.mean(np.square(scores)) - 1) < 4 * (2 / 12) ** 0.5


def test_what_a_camera_looks_at_is_told_but_for_its_distance(ball):
    """The point stays where it was along the view, and the fit ends."""
    name, start = "camera.look_at", np.array([0.1, 0.05, 0.3])
    result = wt.fit(ball.replace({name: start}), wt.render(ball, 16), wrt=[name])
    assert result.stopped.startswith("converged")
    assert result.quality.explained
    assert str(result.quality).endswith("; hardly changes along camera.look_at.z +1")
    assert np.isinf(result.uncertainty[name][2])
    found = np.array(result.parameters[name])
    # Steps were across the view, which was up to 0.1 / 3.7 away from z, and as long as 0.1
    assert found[2] == pytest.approx(0.3, abs=0.1 * 0.1 / 3.7)
    # A pixel is 0.08 wide at the ball, and an edge is found to a hundredth of that
    np.testing.assert_allclose(found[:2], 0, atol=8e-4)


def test_what_trades_off_is_named_with_its_direction(load):
    """A matte ball of twice the albedo in half the light has the same picture."""
    dark = load(BALL.replace("0.1, 0.2, 0.3", "0, 0, 0").replace("0.3, 0.3, 0.3", "0, 0, 0"))
    names = ["materials.red.color", "lights.light0.intensity"]
    start = dark.replace({"materials.red.color": (0.7, 0.4, 0.2)})
    result = wt.fit(start, wt.render(dark, 4), wrt=names)
    words = str(result.quality).split("; ")
    assert len(words) == 4
    for axis, color in zip("xyz", result.parameters[names[0]], strict=True):
        # d log color = - d log intensity
        intensity = dict(zip("xyz", result.parameters[names[1]], strict=True))[axis]
        one, other = f"materials.red.color.{axis}", f"lights.light0.intensity.{axis}"
        ratio = -intensity / color
        pair = (
            f"{other} +1, {one} {1 / ratio:+.2g}"
            if abs(ratio) > 1
            else f"{one} +1, {other} {ratio:+.2g}"
        )
        assert f"hardly changes along {pair}" in words
    assert np.isinf(result.covariance.diagonal()).all()


def test_a_direction_names_what_has_a_part_in_it():
    assert direction(["a.x", "a.y", "b"], np.array([2.0, 0.001, -1.0])) == "a.x +1, b -0.5"
