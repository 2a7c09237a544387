"""A fit tells whether it has found the scene, and goes on where it has not."""

from types import SimpleNamespace

import numpy as np
import pytest

import whitted as wt
from whitted.inverse import coarse_to_fine, search
from whitted.inverse.levenberg_marquardt import levenberg_marquardt
from whitted.inverse.loss import Objective
from whitted.inverse.moves import groups_of
from whitted.inverse.quality import assess, spectrum
from whitted.inverse.views import checked_view

CENTER = "spheres.ball.center"
# Matte, so that its edge and its shading are all that there is
BALL = """
background = [0.1, 0.2, 0.3]
ambient = [0.3, 0.3, 0.3]
max_depth = 1
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
fov = 50
resolution = [48, 48]
[materials.red]
color = [0.8, 0.3, 0.1]
[materials.spare]
color = [0.5, 0.5, 0.5]
[[spheres]]
name = "ball"
center = [0.2, -0.1, 0]
radius = 0.5
material = "red"
[[lights]]
position = [2, 2, 4]
intensity = [0.6, 0.6, 0.6]
"""
# A pixel where the ball is
PIXEL = 2 * 4 * np.tan(np.radians(25)) / 48


@pytest.fixture
def ball(load):
    return load(BALL, "single")


def quality(scene, target, moved=(0, 0, 0), mask=None, **options):
    """Of the scene with its ball moved by so much, against a target."""
    options = {"spp": 4, "boundary": True, "max_depth": None, **options}
    objective = Objective(
        (checked_view(scene, target, mask, None),), (CENTER,), (3,), options, False
    )
    return assess(objective, scene.parameters(CENTER)[CENTER].numpy().ravel() + moved)


def noisy(scene, sigma, seed=0, spp=64):
    picture = wt.render(scene, spp, boundary=False).numpy()
    return picture + np.random.default_rng(seed).normal(scale=1, size=picture.shape) * sigma


@pytest.mark.parametrize("spp", [1, 4, 16, 64])
@pytest.mark.parametrize("sigma", [0.0, 0.01, 0.05])
def test_truth_is_explained(ball, spp, sigma):
    """Also where noise and samples weigh alike, at 1 %."""
    found = quality(ball, noisy(ball, sigma, spp=spp))
    assert found.explained
    assert str(found).startswith("explained (noise ")
    # The median of 1728 moduli is off by 1.2 / sqrt(1728) of itself; four of that
    if spp == 64:
        assert found.noise == pytest.approx(sigma, rel=0.12, abs=1e-6)


def test_noise_that_is_stronger_where_it_is_bright_is_explained(ball):
    """As that of counted photons."""
    bright = np.sqrt(wt.render(ball, 16).numpy())
    found = [quality(ball, noisy(ball, 0.05 * bright, seed)).explained for seed in range(20)]
    # One in 30,000 is called otherwise
    assert all(found)


@pytest.mark.parametrize("boundary", [True, False])
def test_a_ball_off_by_half_a_pixel_leaves_structure(ball, boundary):
    """The noise, 2 %, is a tenth of the step at the edge."""
    options = {"boundary": boundary}
    found = quality(ball, noisy(ball, 0.02), (PIXEL / 2, 0, 0), **options)
    assert not found.explained
    assert str(found).startswith("structured residual: probably a local minimum, or something")
    assert ", structure 0.0" in str(found)


def test_what_is_masked_out_leaves_no_structure(ball):
    target, mask = noisy(ball, 0.02), np.ones((48, 48))
    target[5:12, 5:12] = 1
    assert not quality(ball, target).explained
    mask[4:13, 4:13] = 0
    assert quality(ball, target, mask=mask).explained


def test_one_block_of_structure_is_seen():
    """All of the residual is in one block: what it adds to the spread is bounded."""
    picture = np.random.default_rng(1).normal(scale=0.01, size=(64, 64, 3))
    flat = spectrum([picture])
    assert (flat.together < 4 * flat.spread).all()
    picture[8:12, 8:12] += 0.1
    spoilt = spectrum([picture])
    assert (spoilt.together > 4 * spoilt.spread).any()
    assert spoilt.level == pytest.approx(flat.level, rel=0.05)


def test_fit_names_what_the_picture_does_not_depend_on(ball):
    with pytest.warns(UserWarning, match=r"do not depend on materials\.spare\.color"):
        result = wt.fit(ball, noisy(ball, 0.02), wrt=[CENTER, "materials.spare.color"])
    assert result.quality.explained
    assert str(result.quality).endswith("; does not depend on materials.spare.color.z")
    assert str(result.quality) in repr(result)


FAR = {CENTER: (-1.1, 1.1, 0)}


def test_a_fit_goes_on_where_the_picture_is_not_explained(ball):
    """From where the ball and its picture do not overlap, by one call, and the same every time."""
    target, start = noisy(ball, 0.02), ball.replace(FAR)
    once = wt.fit(start, target, wrt=[CENTER], budget=None, levels=1)
    assert not once.quality.explained
    assert {step.attempt for step in once.history} == {0}
    tries = [wt.fit(start, target, wrt=[CENTER], levels=1) for _ in range(2)]
    for result in tries:
        assert result.quality.explained
        assert result.history[-1].attempt > 0
        off = np.array(result.parameters[CENTER]) - (0.2, -0.1, 0)
        assert (np.abs(off) < 4 * np.array(result.uncertainty[CENTER])).all()
    assert tries[0].parameters == tries[1].parameters
    other = wt.fit(start, target, wrt=[CENTER], levels=1, seed=1)
    assert [step.loss for step in other.history] != [step.loss for step in tries[0].history]


def test_a_fit_that_cannot_succeed_ends_with_its_budget(ball):
    """The picture has another ball. The fit's result is its best, where the history ends."""
    target = wt.render(ball.add(wt.Sphere("b", center=(-1, 1, 0), radius=0.4, material="red")), 16)
    steps = []
    result = wt.fit(ball.replace(FAR), target, wrt=[CENTER], budget=3, callback=steps.append)
    assert not result.quality.explained
    assert steps[-1].attempt > 0
    assert steps[-1].x.tolist() == pytest.approx(result.parameters[CENTER])
    last = [step.loss for step in steps if step.resolution == steps[-1].resolution]
    assert result.loss == pytest.approx(min(last), rel=1e-5)
    assert result.notes == ["further tries ended with the budget; give more, or bounds"]


@pytest.mark.parametrize("method", ["lm", "adam"])
def test_budget_ends_the_first_descent(ball, method):
    """It is over after one picture, at each resolution. Without a budget the fit goes on."""
    target, start = noisy(ball, 0.02), ball.replace({CENTER: (0.3, 0, 0)})
    options = {"wrt": [CENTER], "method": method, "levels": 2}
    result = wt.fit(start, target, budget=1e-6, **options)
    assert result.stopped == "budget used up"
    assert result.notes == ["the descent was ended after 1.7 times the budget; give more"]
    assert [step.resolution[0] for step in result.history] == [24, 48]
    assert not result.quality.explained
    assert result.parameters[CENTER] == pytest.approx((0.3, 0, 0))
    unlimited = wt.fit(start, target, budget=None, **options)
    assert unlimited.quality.explained
    assert unlimited.notes == []


def test_budget_ends_a_descent_between_its_steps(ball, monkeypatch):
    """Each look at the clock takes a second. The third is after 1.7 s."""
    clock = iter(range(10**6))
    monkeypatch.setattr(search, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    monkeypatch.setattr(coarse_to_fine, "time", SimpleNamespace(monotonic=lambda: 0))
    result = wt.fit(
        ball.replace({CENTER: (0.3, 0, 0)}),
        noisy(ball, 0.02),
        wrt=[CENTER],
        levels=1,
        budget=1,
    )
    assert result.stopped == "budget used up"
    assert result.iterations == 2
    assert result.loss < 0.5 * result.history[0].loss


def test_a_fit_goes_on_after_a_try_that_leaves_what_is_finite(ball, monkeypatch):
    """Half of all moves have no finite loss, and the others' first descent fails."""
    target, start = noisy(ball, 0.02), ball.replace(FAR)
    descents = []

    def fail(*arguments):
        descents.append(arguments)
        if len(descents) == 2:
            raise ValueError("the loss became nan")
        return levenberg_marquardt(*arguments)

    monkeypatch.setitem(coarse_to_fine.DESCENTS, "lm", fail)
    exact, calls = Objective.loss, []

    def loss(self, x):
        calls.append(x)
        return np.nan if not self.options["boundary"] and len(calls) % 2 else exact(self, x)

    monkeypatch.setattr(Objective, "loss", loss)
    result = wt.fit(start, target, wrt=[CENTER], levels=1)
    assert result.quality.explained
    assert len(descents) > 2


def test_interrupt_of_a_try_keeps_the_best(ball):
    def interrupt(step):
        if step.attempt == 1:
            raise KeyboardInterrupt

    start = ball.replace(FAR)
    result = wt.fit(start, noisy(ball, 0), wrt=[CENTER], levels=1, callback=interrupt)
    assert result.stopped == "interrupted"
    best = min(result.history, key=lambda step: step.loss)
    np.testing.assert_array_equal(result.parameters[CENTER], best.x)


def test_interrupt_among_starts_tells_how_many_were_tried(ball):
    numbers = []

    def interrupt(step):
        # A start has the number of the iteration before it
        numbers.append(step.iteration)
        if len(numbers) - len(set(numbers)) == 2:
            raise KeyboardInterrupt

    options = {"wrt": [CENTER], "starts": 9, "callback": interrupt}
    result = wt.fit(ball.replace(FAR), noisy(ball, 0), **options)
    assert result.stopped == "interrupted"
    assert result.notes[-1] == "2 of 9 starts were tried"


@pytest.mark.parametrize("side", [1, 2, 3, 12])
def test_small_pictures_have_a_quality(ball, side):
    tiny = ball.replace({"camera.resolution": (side, side)})
    assert quality(tiny, wt.render(tiny, 16)).explained
    if side > 1:
        assert not quality(tiny, wt.render(tiny, 16).numpy() + 0.1).explained


def test_numbers_move_by_parameter_by_object_and_all_together():
    labels = [f"{CENTER}.{axis}" for axis in "xyz"] + ["spheres.ball.radius", "materials.a.ior"]
    groups = {tuple(np.flatnonzero(mask).tolist()) for mask in groups_of(labels)}
    assert groups == {(0, 1, 2), (3,), (4,), (0, 1, 2, 3), (0, 1, 2, 3, 4)}
