"""What is known before, and what the scene lacks: priors and robust losses."""

import numpy as np
import pytest
from samples import camera, keys, light, material, sphere

import whitted as wt
from whitted.inverse.robust import TURN, left_out, robust_loss, robust_weight

CENTER, RADIUS, SPARE = "spheres.ball.center", "spheres.ball.radius", "materials.spare.color"
BALL = (
    keys(background=[0.1, 0.2, 0.3], ambient=[0.3, 0.3, 0.3], max_depth=1)
    + camera([0, 0, 4], [0, 0, 0], 50, (48, 48))
    + material("red", color=[0.8, 0.3, 0.1])
    + material("spare", color=[0.5, 0.5, 0.5])
    + sphere([0.2, -0.1, 0], 0.6, "red", name="ball")
    + light([2, 2, 4], [0.6, 0.6, 0.6])
)


@pytest.fixture
def ball(load):
    return load(BALL, "single")


@pytest.fixture
def noisy(ball):
    picture = wt.render(ball, 16).numpy()
    return picture + np.random.default_rng(2).normal(scale=0.05, size=picture.shape)


@pytest.mark.parametrize("method", ["lm", "adam"])
def test_a_prior_is_weighed_against_the_noise(ball, noisy, method):
    """Known before as well as the picture tells it, and two deviations away: one is left of them.

    The noise is known to a few percent from 1728 differences, and the bar by its own picture; a
    tenth of a bar is the last step of Adam.
    """
    alone = wt.fit(ball, noisy, wrt=[RADIUS], levels=1)
    value, sigma = alone.parameters[RADIUS], alone.uncertainty[RADIUS]
    priors = {RADIUS: (value + 2 * sigma, sigma)}
    both = wt.fit(ball, noisy, wrt=[RADIUS], priors=priors, levels=1, method=method, budget=None)
    assert (both.parameters[RADIUS] - value) / sigma == pytest.approx(1, abs=0.3)
    assert both.uncertainty[RADIUS] / sigma == pytest.approx(0.5**0.5, abs=0.1)


def test_a_prior_is_all_that_is_known_of_what_no_picture_shows(ball, noisy):
    """Each component has its own, and is found to a hundredth of it; there is no warning."""
    priors = {SPARE: ([0.2, 0.4, 0.6], [0.01, 0.02, 0.03])}
    found = wt.fit(ball, noisy, wrt=[CENTER, SPARE], priors=priors, levels=1)
    np.testing.assert_allclose(found.parameters[SPARE], [0.2, 0.4, 0.6], rtol=0, atol=1e-4)
    np.testing.assert_allclose(found.uncertainty[SPARE], [0.01, 0.02, 0.03], rtol=1e-3)
    assert "does not depend" not in str(found.quality)


@pytest.mark.parametrize("kind", ["huber", "cauchy"])
def test_a_thing_that_the_scene_lacks_does_not_pull(ball, noisy, kind):
    """A finger before the lens covers a corner of the ball."""
    spoilt = noisy.copy()
    spoilt[22:40, 28:36] = (0.9, 0.7, 0.6)
    start = ball.replace({CENTER: (0.35, 0.05, 0)})
    pulled = wt.fit(start, spoilt, wrt=[CENTER], budget=None)
    assert not pulled.quality.explained
    found = wt.fit(start, spoilt, wrt=[CENTER], robust=kind, budget=5)
    away = [np.abs(np.array(one.parameters[CENTER]) - (0.2, -0.1, 0)) for one in (pulled, found)]
    assert away[1].max() < 0.2 * away[0].max()
    assert found.quality.explained
    # The finger, and a pixel around it; noise leaves out few others
    assert 18 * 8 / 48**2 < found.quality.left_out < 2 * 20 * 10 / 48**2
    assert f"but for {found.quality.left_out:.2g} of the pixels" in str(found.quality)


@pytest.mark.parametrize("kind", TURN)
def test_robust_losses_and_their_weights(kind):
    """Small residuals count by their squares; the weight is the derivative."""
    square = np.array([1e-6, 0.5, 1, 4, 100.0])
    step = 1e-6
    slope = (robust_loss(kind, square + step) - robust_loss(kind, square - step)) / (2 * step)
    # A step of 1e-6 leaves 1e-16 / 1e-6 of roundings
    np.testing.assert_allclose(robust_weight(kind, square), slope, rtol=0, atol=1e-7)
    assert robust_loss(kind, square)[0] == pytest.approx(1e-6, rel=1e-5)
    assert (robust_loss(kind, square) <= square).all()


def test_what_is_left_out_has_its_neighbours_with_it():
    weight = np.ones((5, 6, 1))
    weight[0, 2] = 0.1
    expected = np.zeros((5, 6, 1), bool)
    expected[:2, 1:4] = True
    np.testing.assert_array_equal(left_out(weight), expected)


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"priors": [1]}, ValueError, r"priors: expected a dictionary .*, got \[1\]"),
        ({"priors": {RADIUS: (1, 1)}}, KeyError, f"priors: '{RADIUS}' is not among the parameters"),
        ({"priors": {"ball": (1, 1)}}, KeyError, "priors: 'ball' is not among the parameters"),
        (
            {"priors": {CENTER: (1, 0)}},
            ValueError,
            rf"priors: {CENTER}: expected a sigma > 0, got \(1, 0\); leave out what is fixed",
        ),
        ({"priors": {CENTER: 3}}, ValueError, r"expected \(mean, sigma\), each a number or 3 of"),
        ({"priors": {CENTER: ([1, 2], 1)}}, ValueError, r"expected \(mean, sigma\), each a number"),
        ({"priors": {CENTER: (np.inf, 1)}}, ValueError, "expected finite numbers, got"),
        ({"robust": "l1"}, ValueError, "robust: expected one of huber, cauchy, or None, got 'l1'"),
        ({"robust": "huber", "gain": True}, ValueError, "robust: not with gain=True; fit an inten"),
    ],
)
def test_priors_and_losses_that_make_no_sense_are_refused(ball, noisy, options, error, match):
    with pytest.raises(error, match=match):
        wt.fit(ball, noisy, wrt=[CENTER], **options)
