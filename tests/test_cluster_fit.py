"""Fits from many starts, on workers and here."""

import re

import numpy as np
import pytest
from cluster_scene import matte as ball

import whitted as wt
from whitted import cluster
from whitted.cli import run
from whitted.cluster import connect, starts, trials
from whitted.inverse.coarse_to_fine import Plan

CENTER = "spheres.ball.center"
SIZE = (32, 24)
# The start is so far off that the pictures of the ball do not overlap
START = {CENTER: (-1.2, -0.6, -0.3)}
FIT = {"wrt": [CENTER], "resolution": SIZE, "spp": 1, "budget": None, "starts": 12}


@pytest.fixture(scope="module")
def client():
    pytest.importorskip("distributed", reason="needs Dask: pip install 'whitted[cluster]'")
    with connect.connected(None, 2) as client:
        yield client


@pytest.fixture(scope="module")
def target():
    return wt.render(ball().replace({CENTER: (0.8, 0.4, 0.1)}), 1, resolution=SIZE)


@pytest.fixture(scope="module")
def found(target):
    return cluster.fit(ball().replace(START), target, **FIT)


def test_many_starts_find_what_one_does_not(target, found):
    one = wt.fit(ball().replace(START), target, **{**FIT, "starts": 1}, progress=False)
    assert one.loss > 100 * found.loss
    # The same scene, with the same samples
    np.testing.assert_allclose(found.parameters[CENTER], (0.8, 0.4, 0.1), atol=1e-3)
    assert found.quality.explained


def test_workers_find_the_same(target, found, client):
    """To the last bit, in whatever order tasks end."""
    done = []
    again = cluster.fit(ball().replace(START), target, client, **FIT, progress=done.append)
    assert again.parameters == found.parameters
    assert again.loss == found.loss
    assert again.scene == found.scene
    assert done == sorted(done)
    assert done[-1] <= 1


def test_views_are_fitted(target):
    """Two views, as `fit` takes them."""
    views = [(ball().replace(START), target.numpy())] * 2
    result = cluster.fit(views, **{**FIT, "starts": 2, "iterations": 2}, best=1)
    assert result.gains.shape == (2, 3)


def test_starts_are_those_of_fit():
    one = trials.Trials(
        ball(), np.zeros((24, 32, 3)), [CENTER], Plan("auto", None, None, 9, 5), {"spp": 1}
    )
    np.testing.assert_array_equal(one.starts[0], (0, 0, 0))
    assert len({tuple(start) for start in one.starts}) == 9
    assert [len(one.starts[k * 4 : k * 4 + 4]) for k in range(one.tasks)] == [4, 4, 1]


@pytest.mark.parametrize(
    ("when", "notes"),
    [(1, ["0 of 12 starts were tried"]), (2, ["4 of 12 starts were tried"]), (5, [])],
)
def test_ctrl_c_gives_the_best_so_far(target, when, notes):
    """After the first task, after the second, and after one end has gone its whole way."""
    told = []

    def stop(fraction):
        told.append(fraction)
        if len(told) == when:
            raise KeyboardInterrupt

    result = cluster.fit(ball().replace(START), target, **FIT, progress=stop)
    assert result.stopped == "interrupted"
    assert result.notes == notes
    # The first steps count where nothing has come after them
    assert (result.iterations > 0) == (when == 2)
    assert len(told) == when


def test_starts_that_fail_are_left_out(target, monkeypatch):
    """Those that leave what is finite, and those whose task fails."""
    trial = trials.trial

    def some(search, coarsest, start, method):
        if start[0] != START[CENTER][0]:
            raise ValueError("the loss became inf")
        return trial(search, coarsest, start, method)

    monkeypatch.setattr(trials, "trial", some)
    result = cluster.fit(ball().replace(START), target, **{**FIT, "iterations": 1})
    assert np.isfinite(result.loss)

    def none(*given):
        raise RuntimeError("no luck")

    monkeypatch.setattr(trials, "trial", none)
    message = "^fit: all tasks have failed three times: RuntimeError: no luck$"
    with pytest.raises(RuntimeError, match=message):
        cluster.fit(ball().replace(START), target, **FIT)


def test_ends_that_are_alike_are_one(target, monkeypatch):
    contest = starts._Contest(
        None,
        trials.Trials(
            ball(), target, [CENTER], Plan("auto", None, None, 1, 0), {"resolution": SIZE}
        ),
        3,
        lambda fraction: None,
    )
    a, b, c = (0.0, 0.0, 0.0), (1e-4, 0.0, 0.0), (0.5, 0.0, 0.0)
    contest.ends = [(0.3, c, 1), (0.1, a, 1), (0.2, b, 1), (np.inf, (9.0, 9.0, 9.0), 1)]
    assert contest._best_ends() == [a, c]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"starts": 0}, "starts: expected a whole number from 1 on, got 0"),
        ({"best": 2.5}, "best: expected a whole number from 1 on, got 2.5"),
        ({"wrt": []}, "wrt: expected names of parameters, got an empty list"),
        ({"levels": 9}, "levels: 9 halvings leave nothing of 24 pixels"),
        ({"spp": 3}, "spp: expected a perfect square"),
        ({"resolution": (8, 8)}, "target: expected an image of 8 x 8 pixels"),
    ],
)
def test_bad_input_is_refused(target, options, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        cluster.fit(ball(), target, **{**FIT, **options})


def test_command(target, tmp_path, capsys):
    ball().replace({**START, "camera.resolution": SIZE}).save(tmp_path / "start.toml")
    wt.write_image(tmp_path / "target.exr", target)
    words = f"fit --wrt {CENTER} --spp 1 --once --starts 12 --workers 1".split()
    files = [str(tmp_path / name) for name in ("start.toml", "target.exr")]
    assert run([*words, *files, "-o", str(tmp_path / "out")]) == 0
    assert re.search(rf"{re.escape(CENTER)}\.x +0\.(80|79)", capsys.readouterr().out)
