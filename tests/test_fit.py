"""Fits of one small scene whose answer is known, and every wrong way to ask for one.

A pixel is 0.16 wide, and a fit finds an edge to a hundredth of that. How far away a ball of radius
r is, at a distance of 4, only its size in the picture tells: 4 / r times less well.
"""

import base64
import warnings

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad

import whitted as wt
from whitted.inverse import problem
from whitted.inverse.bounds import bounds_of, scales_of
from whitted.inverse.coarse_to_fine import chosen
from whitted.inverse.convergence import Iteration
from whitted.inverse.loss import Objective, split
from whitted.inverse.quality import Quality
from whitted.inverse.views import checked_view

BALL = """
background = [0.1, 0.2, 0.3]
ambient = [0.3, 0.3, 0.3]
max_depth = 1
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
fov = 50
resolution = [32, 24]
[materials.red]
color = [0.8, 0.3, 0.1]
[materials.spare]
color = [0.5, 0.5, 0.5]
[[spheres]]
name = "ball"
center = [0.2, -0.1, 0]
radius = 0.8
material = "red"
[[lights]]
position = [2, 2, 4]
intensity = [0.6, 0.6, 0.6]
"""
CENTER, RADIUS = np.array([0.2, -0.1, 0]), 0.8
FOUND = 1.6e-3  # a hundredth of a pixel
NEAR = np.array([FOUND, FOUND, FOUND * 4 / RADIUS])
AWAY = {"spheres.ball.center": [0.5, 0.2, -0.3]}
WRT = ["spheres.ball.center"]


@pytest.fixture
def ball(load):
    return load(BALL, "single")


@pytest.fixture
def target(ball):
    return wt.render(ball, 16)


def test_recovers_position_and_radius(ball, target):
    start = ball.replace({**AWAY, "spheres.ball.radius": 0.6})
    result = wt.fit(start, target, wrt=["spheres.ball.center", "spheres.ball.radius"])
    error = np.abs(np.array(result.parameters["spheres.ball.center"]) - CENTER)
    assert np.all(error < NEAR)
    assert result.parameters["spheres.ball.radius"] == pytest.approx(RADIUS, abs=FOUND)
    # The scene has the numbers in single precision
    np.testing.assert_allclose(
        result.scene.parameters(*WRT)[WRT[0]].numpy().ravel(), result.parameters[WRT[0]], rtol=1e-6
    )
    assert result.stopped.startswith("converged")
    assert result.labels == [f"spheres.ball.center.{axis}" for axis in "xyz"] + [
        "spheres.ball.radius"
    ]
    assert len({step.resolution for step in result.history}) == 1
    # An edge that was off by two pixels is off by less than 1/30 of that: squared, 1e-3
    assert result.loss < 1e-3 * result.history[0].loss


def test_a_silhouette_alone_tells_the_place(load):
    """In ambient light only the edge tells where the ball is, and plain samples have no derivative
    by that.
    """
    flat = load(BALL.replace("intensity = [0.6, 0.6, 0.6]", "intensity = [0, 0, 0]"), "single")
    picture, start = wt.render(flat, 16), flat.replace(AWAY)
    result = wt.fit(start, picture, wrt=WRT)
    assert np.all(np.abs(np.array(result.parameters[WRT[0]]) - CENTER) < NEAR)
    with pytest.warns(UserWarning, match=r"do not depend on spheres\.ball\.center"):
        plain = wt.fit(start, picture, wrt=WRT, boundary=False, budget=None)
    np.testing.assert_allclose(plain.parameters[WRT[0]], AWAY[WRT[0]])


def test_up_to_a_hundred_numbers_take_second_order_steps(ball):
    """If their derivatives fit in memory; others take Adam's."""
    for count, size, method in (
        (16, 2048, "lm"),
        (60, 1024, "adam"),
        (60, 512, "lm"),
        (100, 128, "lm"),
        (101, 128, "adam"),
    ):
        view = checked_view(ball, np.zeros((size, size, 3)), None, (size, size))
        objective = Objective((view,), ("a",), ((count,),), {}, False)
        assert chosen("auto", objective) == method
        assert chosen("adam", objective) == "adam"


def test_positions_of_eight_balls_at_once(ball):
    """24 numbers, by second-order steps. A pixel is half as wide as elsewhere, as the balls are."""
    rows = [(x, y, 0) for y in (-0.6, 0.6) for x in (-1.2, -0.4, 0.4, 1.2)]
    balls = [
        wt.Sphere(f"b{k}", center=row, radius=0.3, material="red") for k, row in enumerate(rows)
    ]
    many = ball.remove("ball").add(*balls)
    random = np.random.default_rng(4)
    # A quarter of a radius
    away = [row + random.uniform(-0.075, 0.075, 3) for row in rows]
    start = many.replace({f"spheres.b{k}.center": place for k, place in enumerate(away)})
    size = {"resolution": (64, 48)}
    result = wt.fit(start, wt.render(many, 16, **size), wrt="spheres.*.center", **size)
    assert result.quality.explained
    off = np.abs(np.array(list(result.parameters.values())) - rows)
    assert np.all(off < [FOUND, FOUND, FOUND * 4 / 0.3])


def test_adam_recovers_a_position(ball, target):
    result = wt.fit(ball.replace(AWAY), target, wrt=WRT, method="adam", spp=1, iterations=150)
    # Adam's last steps are 0.05 * 0.05 of the radius
    np.testing.assert_allclose(result.parameters[WRT[0]][:2], CENTER[:2], rtol=0, atol=2e-3)


@pytest.mark.parametrize("method", ["lm", "adam"])
@pytest.mark.parametrize("levels", [1, 2])
def test_the_start_is_no_iteration(ball, target, method, levels):
    start = ball.replace(AWAY)
    options = {"method": method, "iterations": 1, "levels": levels, "budget": None}
    result = wt.fit(start, target, wrt=WRT, **options)
    steps = [step.iteration for step in result.history]
    assert steps == ([0, 1] if levels == 1 else [0, 1, 1, 2])
    assert result.iterations == levels
    told = "after 1 iteration; loss" if levels == 1 else "after 2 iterations at 2 resolutions; loss"
    assert told in repr(result)
    # The step has been made
    assert result.parameters[WRT[0]] != list(AWAY[WRT[0]])


def test_coarse_pictures_come_first(ball):
    resolution = (96, 96)
    target = wt.render(ball, 4, resolution=resolution)
    steps = []
    result = wt.fit(
        ball.replace(AWAY), target, wrt=WRT, resolution=resolution, callback=steps.append
    )
    numbers = [step.iteration for step in steps]
    assert numbers == [step.iteration for step in result.history]
    # At each of the three resolutions the first loss is that of the last step
    assert sorted(set(numbers)) == list(range(len(steps) - 2))
    starts = [k for k in range(1, len(steps)) if steps[k].resolution != steps[k - 1].resolution]
    assert all(numbers[k] == numbers[k - 1] for k in starts)
    sizes = [step.resolution for step in steps]
    assert sizes == sorted(sizes)
    assert set(sizes) == {(24, 24), (48, 48), (96, 96)}


def test_halved_targets_are_pictures_at_half_the_resolution(ball):
    """A pixel is the mean over its area, so four of them are one of the coarser picture."""
    fine, coarse = (wt.render(ball, 64, resolution=size).numpy() for size in ((64, 48), (32, 24)))
    halved = checked_view(ball, fine, None, (64, 48), "").halved()
    # An edge of 8 strips a pixel is straight in each: with a radius R of 5 pixels, each is off by
    # (1/8)^3 / (12 R) = 3e-5 of a pixel; four times that is where an edge enters or leaves a pixel
    assert np.abs(halved.target - coarse).max() < 1e-3


def test_what_is_masked_out_does_not_count(ball, target):
    """What is masked out does not count, even where it is not a number."""
    spoilt, mask = target.numpy().copy(), np.ones((24, 32))
    spoilt[:, 20:] = np.nan
    mask[:, 20:] = 0
    result = wt.fit(ball.replace(AWAY), spoilt, wrt=WRT, mask=mask)
    np.testing.assert_allclose(result.parameters[WRT[0]], CENTER, rtol=0, atol=FOUND)


def test_gains_are_fitted_along(ball, target):
    exposure = np.array([2.0, 0.5, 1.3])
    result = wt.fit(ball.replace(AWAY), target.numpy() * exposure, wrt=WRT, gain=True)
    np.testing.assert_allclose(result.parameters[WRT[0]], CENTER, rtol=0, atol=FOUND)
    # A hundredth of a pixel's width in 30 pixels on the edge, of 200 on the ball
    np.testing.assert_allclose(result.gains, [exposure], rtol=1e-3)


def test_several_views_agree(ball):
    """One view hardly tells the distance of a ball of unknown size; two views do."""
    views = []
    for x in (-1.5, 1.5):
        there = ball.replace({"camera.position": [x, 0, 3.7]})
        views.append((there.replace(AWAY), wt.render(there, 16)))
    result = wt.fit(views, wrt=[*WRT, "spheres.ball.radius"])
    np.testing.assert_allclose(result.parameters[WRT[0]], CENTER, rtol=0, atol=1e-3)
    assert result.gains.shape == (2, 3)


def test_second_derivatives_and_gradients_agree(ball, target):
    """Forward and reverse mode find the same gradient of the loss, with a gain and a mask."""
    mask = np.linspace(0.5, 2, 24 * 32).reshape(24, 32)
    sizes = {"spheres.ball.center": 3, "lights.light0.intensity": 3}
    options = {"spp": 1, "boundary": True, "max_depth": None}
    views = (checked_view(ball, target, mask, None, ""),)
    objective = Objective(views, tuple(sizes), ((3,), (3,)), options, gain=True)
    x = np.array([0.5, 0.2, -0.3, 0.7, 0.6, 0.5])
    loss, slope, _ = objective.normal_equations(x)
    values = {
        name: type(value)(*split(sizes_as(sizes), x)[name])
        for name, value in ball.parameters(*sizes).items()
    }
    dr.enable_grad(values)
    # Sums of 2304 terms in single precision: roundings of 6e-8 with random signs add up to 50
    assert objective.gradient(values) == pytest.approx(loss, rel=3e-6)
    assert objective.loss(x) == pytest.approx(loss, rel=3e-6)
    gradient = np.concatenate([dr.grad(value).numpy().ravel() for value in values.values()])
    np.testing.assert_allclose(gradient, slope, rtol=0, atol=1e-5 * np.abs(slope).max())


@pytest.mark.parametrize("kept", [1 << 24, 0], ids=["kept", "too many"])
def test_derivatives_at_the_same_numbers_are_taken_once(ball, target, monkeypatch, kept):
    """Error bars need those of the last step; too many are not kept, and are the same."""
    monkeypatch.setattr("whitted.inverse.loss.KEPT", kept)
    taken, original = [], Objective._residuals_and_slopes

    def count(self, x):
        taken.append(x)
        return original(self, x)

    monkeypatch.setattr(Objective, "_residuals_and_slopes", count)
    views = (checked_view(ball, target, None, None, ""),)
    options = {"spp": 1, "boundary": True, "max_depth": None}
    objective = Objective(views, tuple(WRT), ((3,),), options, gain=False)
    x = np.array([0.5, 0.2, -0.3])
    fresh = objective.residuals(x)[0]
    first, again = (list(objective.linearised(x)) for _ in range(2))
    assert len(taken) == (1 if kept else 2)
    objective.loss(x + 0.1)
    np.testing.assert_array_equal(objective.residuals(x)[0], fresh)
    for one, two in zip(first[0][1:], again[0][1:], strict=True):
        np.testing.assert_array_equal(one, two)


def sizes_as(sizes):
    return {name: np.zeros(size) for name, size in sizes.items()}


def test_error_bars_are_those_of_the_noise(ball, target):
    """Over ten pictures with noise, the errors' mean square in units of the bars is 1.

    The mean of 30 squares of normal numbers has a standard deviation of sqrt(2 / 30); four of them
    are exceeded once in 16,000 runs.
    """
    random, scores = np.random.default_rng(3), []
    for _ in range(10):
        noisy = target.numpy() + random.normal(scale=0.02, size=target.shape)
        result = wt.fit(ball, noisy, wrt=WRT, levels=1)
        scores.extend((np.array(result.parameters[WRT[0]]) - CENTER) / result.uncertainty[WRT[0]])
    assert abs(np.mean(np.square(scores)) - 1) < 4 * (2 / 30) ** 0.5


def test_several_starts_find_what_one_does_not(ball):
    far = {"spheres.ball.center": [-2.2, 1.2, 0]}
    small = ball.replace({"spheres.ball.radius": 0.3})
    picture = wt.render(small, 16)
    bounds = {"spheres.ball.center": (-2.5, 2.5)}
    options = {"wrt": WRT, "bounds": bounds, "budget": None}
    one = wt.fit(small.replace(far), picture, **options)
    several = wt.fit(small.replace(far), picture, **options, starts=40)
    assert np.abs(np.array(one.parameters[WRT[0]]) - CENTER).max() > 0.5
    off = np.abs(np.array(several.parameters[WRT[0]]) - CENTER)
    assert np.all(off < [FOUND, FOUND, 0.02])  # FOUND * 4 / 0.3


@pytest.mark.parametrize("method", ["lm", "adam"])
def test_bound_holds_and_a_note_tells_it(ball, target, method):
    name = "spheres.ball.radius"
    result = wt.fit(
        ball.replace({name: 0.6}),
        target,
        wrt=[name],
        bounds={name: (None, 0.7)},
        method=method,
        iterations=60,
        budget=None,
    )
    assert result.parameters[name] == pytest.approx(0.7, rel=6e-8)  # a rounding
    assert result.notes == [f"{name} was held at its bound 0.7"]


def test_default_bounds_are_what_is_legal_and_usual(ball):
    names = [
        "spheres.ball.radius",
        "materials.red.color",
        "materials.red.ior",
        "camera.fov",
        "camera.position",
    ]
    low, high = bounds_of(ball, names, {})
    # A number that must stay above 0 does so by a thousandth of its start, in single precision
    free = [np.inf] * 3
    assert low.tolist() == pytest.approx([8e-4, 0, 0, 0, 1, 0.05, *(-np.inf,) * 3], rel=6e-8)
    assert high.tolist() == pytest.approx([np.inf, 1, 1, 1, np.inf, 179.999, *free], rel=1e-15)
    assert (
        bounds_of(ball.replace({"materials.red.ior": 0.7}), ["materials.red.ior"], {})[0][0] < 0.7
    )
    assert (scales_of(ball, names) > 0).all()


def test_a_parameter_without_effect_is_named(ball, target):
    with pytest.warns(UserWarning, match=r"do not depend on materials\.spare\.color") as warned:
        result = wt.fit(ball.replace(AWAY), target, wrt=[*WRT, "materials.spare.color"])
    assert len(warned) == 3
    np.testing.assert_allclose(result.parameters[WRT[0]], CENTER, rtol=0, atol=1e-3)
    assert result.parameters["materials.spare.color"] == [0.5] * 3
    assert np.isinf(result.uncertainty["materials.spare.color"]).all()


@pytest.mark.parametrize("method", ["lm", "adam"])
def test_no_slope_ends_the_fit(ball, target, method):
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        result = wt.fit(ball, target, wrt=["materials.spare.color"], method=method)
    assert len(warned) == 3
    assert "start elsewhere" in result.stopped


@pytest.mark.parametrize("method", ["lm", "adam"])
def test_interrupt_keeps_the_best(ball, target, method):
    def interrupt(step):
        if step.iteration == 4:
            raise KeyboardInterrupt

    result = wt.fit(ball.replace(AWAY), target, wrt=WRT, method=method, callback=interrupt)
    assert result.stopped == "interrupted"
    best = min(result.history, key=lambda step: step.loss)
    np.testing.assert_array_equal(result.parameters[WRT[0]], best.x)


@pytest.mark.parametrize("method", ["lm", "adam"])
def test_later_iterations_compile_nothing(ball, target, method):
    """The kernels of the first two iterations serve all others."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        compiled = []

        def count(step):
            compiled.append(
                sum(not entry["cache_hit"] for entry in dr.kernel_history([dr.KernelType.JIT]))
            )

        wt.fit(
            ball.replace(AWAY),
            target,
            wrt=WRT,
            method=method,
            iterations=8,
            budget=None,
            callback=count,
        )
    assert len(compiled) > 5
    assert not any(compiled[2:])


def test_mask_of_truth_values(ball, target):
    mask = np.arange(24 * 32).reshape(24, 32) % 3 == 0
    weight = checked_view(ball, target, mask, None).weight
    assert weight.dtype == np.float32
    np.testing.assert_array_equal(weight[..., 0], mask)


def test_plot_shows_every_number(ball, target, tmp_path):
    result = wt.fit(ball.replace(AWAY), target, wrt=WRT, iterations=3, budget=None)
    figure = result.plot(str(tmp_path / "a.png"))
    assert (tmp_path / "a.png").stat().st_size > 5000
    assert [len(axes.lines) for axes in figure.axes] == [1, 3]


def bad(**options):
    return pytest.param(options, id=next(iter(options)))


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"wrt": []}, ValueError, "empty list"),
        ({"wrt": [*WRT, *WRT]}, ValueError, "named twice"),
        ({"wrt": ["spheres.bal.center"]}, KeyError, "nearest: spheres.ball.center"),
        ({"wrt": ["camera.up"]}, KeyError, "no parameter 'camera.up'"),
        ({"wrt": "spheres.*.centre"}, KeyError, "nearest: spheres.ball.center"),
        (
            # A star names several, of which this is one
            {"wrt": ["lights.*"], "bounds": {"lights.light0.position": (5, 9)}},
            ValueError,
            r"starts at 2, 2, 4, outside \[5, 9\]",
        ),
        ({"bounds": [(0, 1)]}, ValueError, r"bounds: expected a dictionary .*, got \[\(0, 1\)\]"),
        ({"seed": -1, "starts": 2}, ValueError, "seed: expected a whole number from 0 on, got -1"),
        ({"wrt": f"{WRT[0]}.x"}, KeyError, f"is a component; name the whole parameter, '{WRT[0]}'"),
        ({"method": "sgd"}, ValueError, "expected one of auto, lm, adam, got 'sgd'"),
        ({"iterations": 0}, ValueError, "iterations: expected a whole number from 1 on"),
        ({"budget": 0}, ValueError, "budget: expected a number of seconds > 0, or None .*, got 0"),
        ({"budget": "long"}, ValueError, "budget: expected a number of seconds > 0.*, got 'long'"),
        ({"starts": 1.5}, ValueError, "starts: expected a whole number from 1 on"),
        ({"levels": 9}, ValueError, "9 halvings leave nothing of 24 pixels"),
        ({"spp": 3}, ValueError, "perfect square"),
        ({"progress": print}, ValueError, "expected True or False; give a function as callback"),
        ({"resolution": (16, 16)}, ValueError, "expected an image of 16 x 16 pixels"),
        ({"mask": np.ones((3, 3))}, ValueError, "mask: expected shape"),
        ({"mask": np.zeros((24, 32))}, ValueError, "not all 0"),
        ({"mask": "no"}, ValueError, "mask: expected an array of numbers, got str"),
        (
            {"mask": np.ones((24, 32), int)},
            ValueError,
            r"mask: integers \(int64\) are no weights; write mask > 0, or divide by 255",
        ),
        ({"bounds": {"spheres.ball.radius": (0, 1)}}, KeyError, "not among the parameters to fit"),
        ({"bounds": {WRT[0]: (0.3, 1)}}, ValueError, r"starts at 0.2, -0.1, 0, outside \[0.3, 1\]"),
        ({"bounds": {WRT[0]: (1, 0)}}, ValueError, "is not below the highest"),
        ({"bounds": {WRT[0]: 3}}, ValueError, r"expected \(lowest, highest\), got 3"),
        (
            {"wrt": ["materials.red.color"], "bounds": {"materials.red.color": (0, 2)}},
            ValueError,
            "not within what is legal",
        ),
    ],
)
def test_argument_that_makes_no_sense_is_refused(ball, target, options, error, match):
    with pytest.raises(error, match=match):
        wt.fit(ball, target, **{"wrt": WRT, **options})


def test_target_that_does_not_fit_the_scene_is_refused(ball, target):
    with pytest.raises(ValueError, match="target: expected an image, got None"):
        wt.fit(ball, wrt=WRT)
    with pytest.raises(ValueError, match="expected an image of 32 x 24 pixels"):
        wt.fit(ball, np.zeros((24, 31, 3)), wrt=WRT)
    spoilt = target.numpy().copy()
    spoilt[5, 7] = np.nan
    with pytest.raises(ValueError, match="1 pixels are not finite numbers, the first at x 7, y 5"):
        wt.fit(ball, spoilt, wrt=WRT)
    picture = ad.TensorXu([0] * (24 * 32 * 3), (24, 32, 3))
    for integers in (picture, picture.numpy().astype(np.uint8)):
        with pytest.raises(
            ValueError, match=r"target: integers \(uint.*\) are no radiance; divide"
        ):
            wt.fit(ball, integers, wrt=WRT)
    with pytest.raises(ValueError, match="target: truth values are no radiance; convert them to"):
        wt.fit(ball, target.numpy() > 0, wrt=WRT)
    with pytest.raises(ValueError, match=r"of numbers, got str; read a file by read_image$"):
        wt.fit(ball, "target.png", wrt=WRT)
    with pytest.raises(ValueError, match="target: expected an array of numbers, got list"):
        wt.fit(ball, [[0.0], [0.0, 1.0]], wrt=WRT)
    with pytest.raises(ValueError, match=r"view 1: target: expected an image"):
        wt.fit([(ball, target), (ball, np.zeros((2, 2, 3)))], wrt=WRT)
    with pytest.raises(ValueError, match="give each as"):
        wt.fit([(ball, target)], target, wrt=WRT)
    with pytest.raises(ValueError, match=r"expected at least one pair \(scene, target\), got none"):
        wt.fit([], wrt=WRT)
    with pytest.raises(TypeError, match=r"^view 1: expected \(scene, target\) or .*, got a Scene$"):
        wt.fit([(ball, target), ball], wrt=WRT)
    with pytest.raises(TypeError, match=r"^view 0: scene: expected a Scene, got 'a.toml'; load"):
        wt.fit([("a.toml", target)], wrt=WRT)


def test_a_number_that_ceases_to_be_finite_is_named(ball, target, monkeypatch):
    start = ball.replace(AWAY)
    monkeypatch.setattr(
        Objective, "normal_equations", lambda self, x: (np.nan, np.zeros(3), np.eye(3))
    )
    with pytest.raises(
        ValueError, match=r"the loss became nan in iteration 0, at spheres\.ball\.center\.x = 0\.5"
    ):
        wt.fit(start, target, wrt=WRT)
    monkeypatch.setattr(
        Objective, "normal_equations", lambda self, x: (1.0, np.array([0, np.inf, 0]), np.eye(3))
    )
    with pytest.raises(
        ValueError, match=r"the derivative by spheres\.ball\.center\.y is not finite in iteration 0"
    ):
        wt.fit(start, target, wrt=WRT)
    monkeypatch.setattr(Objective, "parameters", lambda self, x: {WRT[0]: [0.0, 0.0, 0.0]})
    monkeypatch.setattr(
        Objective, "normal_equations", lambda self, x: (1.0, np.zeros(3), np.eye(3))
    )
    monkeypatch.setattr(problem, "start_of", lambda scene, name: np.array([0.0, np.nan, 0.0]))
    with pytest.raises(ValueError, match=r"spheres\.ball\.center\.y became nan in iteration 0"):
        wt.fit(start, target, wrt=WRT)


def result_of(scene, names, **more):
    """A result as a fit would give it, of parameters that are numbers."""
    count = len(names)
    return wt.FitResult(
        **{
            "scene": scene,
            "parameters": dict(zip(names, np.arange(1.0, count + 1), strict=True)),
            "uncertainty": dict.fromkeys(names, 0.5),
            "covariance": np.eye(count) / 4,
            "labels": list(names),
            "loss": 0.00125,
            "quality": Quality(True, "explained", 0.05, 0.002, 0.0),
            "gains": np.ones((1, 3)),
            "history": [Iteration(7, (32, 24), 0.00125, np.arange(1.0, count + 1))],
            "stopped": "converged",
            **more,
        }
    )


def test_a_result_is_printed_as_a_short_table(ball):
    result = result_of(ball, ["spheres.ball.radius", "materials.<b>.ior"])
    assert repr(result).splitlines() == [
        "FitResult: converged, after 7 iterations; loss 0.00125",
        "explained (noise 0.05, sampling 0.002)",
        "spheres.ball.radius              1 +- 0.5",
        "materials.<b>.ior                2 +- 0.5",
    ]
    many = result_of(ball, [f"spheres.sphere{i}.radius" for i in range(500)])
    assert repr(many).endswith("and 484 more")
    assert len(repr(many)) < 2000


def test_a_notebook_shows_the_numbers_and_the_picture_of_a_result(ball):
    page = result_of(ball, ["spheres.ball.radius", "materials.<b>.ior"])._repr_html_()
    rows = [["spheres.ball.radius", "1", "0.5"], ["materials.&lt;b&gt;.ior", "2", "0.5"]]
    cells = (f"<tr><td>{'</td><td>'.join(row)}</td></tr>" for row in rows)
    assert "".join(cells) in page
    picture = base64.b64encode(ball._repr_png_()).decode()
    assert f'src="data:image/png;base64,{picture}"' in page
