"""Charts of a small scene: every group, every file, and runs that go on where they were."""

import json

import drjit as dr
import numpy as np
import pytest

from whitted.cli import run
from whitted.measure import experiments
from whitted.measure.chart import chart, front, slope
from whitted.measure.store import Store, in_turns

SCENE = """
background = [0.1, 0.2, 0.3]
ambient = [0.2, 0.2, 0.2]
max_depth = 2
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
fov = 50
resolution = [32, 32]
[materials.red]
color = [0.8, 0.3, 0.1]
[[spheres]]
center = [0.1, 0, 0]
radius = 0.8
material = "red"
[[lights]]
position = [2, 2, 4]
intensity = [0.6, 0.6, 0.6]
"""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.setattr(experiments, "COUNTS", (1, 2, 4, 8))
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_report_has_all_groups_and_is_resumed(scene, tmp_path, capsys, monkeypatch):
    folder = tmp_path / "charts"
    assert run(["chart", str(scene), "-o", str(folder), "--quick", "--size", "24x24"]) == 0
    assert "wrote" in capsys.readouterr().out
    names = {path.name for path in folder.iterdir()}
    groups = list(experiments.Experiments(scene, (24, 24), True).groups)
    assert {f"{name}.csv" for name in groups} | {
        "measured.json",
        "report.html",
        "image.png",
        "gradient.png",
        "memory.png",
    } <= names
    page = (folder / "report.html").read_text()
    assert all(f'src="{name}"' in page for name in names if name.endswith(".png"))
    assert "d image / d spheres.sphere0.center.x" in page
    kept = json.loads((folder / "measured.json").read_text())
    rows = {row["name"]: row for row in kept["groups"]["image"]}
    assert (
        rows["boundary, spp 1"]["error"]
        < rows["plain, spp 4"]["error"]
        < rows["plain, spp 1"]["error"]
        < 1
    )
    errors = {
        kind: [r["error"] for r in kept["groups"]["gradient"] if r["kind"] == kind]
        for kind in ("boundary", "plain AD")
    }
    assert min(errors["boundary"]) < 0.1 < min(errors["plain AD"])
    modes = {row["name"]: row["error"] for row in kept["groups"]["modes"]}
    for what in ("one", "all"):
        reverse, forward = (
            modes[f"boundary, reverse, {what}, double, spp 1"],
            modes["boundary, forward, double, spp 1"],
        )
        assert reverse == pytest.approx(forward, abs=1e-9)
        assert reverse < modes[f"plain AD, reverse, {what}, single, spp 1"]

    # All is measured: nothing is measured again, unless the conditions change
    def fail(*_):
        raise AssertionError

    with monkeypatch.context() as patch:
        patch.setattr("whitted.measure.experiments.in_turns", fail)
        chart(
            scene,
            folder,
            json.loads((folder / "measured.json").read_text())["conditions"]["whitted"],
            size=(24, 24),
            quick=True,
        )
        with pytest.raises(AssertionError):
            chart(scene, folder, "another", size=(24, 24), quick=True)


def test_interrupted_runs_go_on(tmp_path):
    path, calls = tmp_path / "a.json", []

    def rows(name):
        calls.append(name)
        if calls == ["a", "b"]:
            raise KeyboardInterrupt
        return [{"name": name, "ms": 1.0}]

    first = Store(path, {"scene": 1})
    first.group("a", lambda: rows("a"))
    with pytest.raises(KeyboardInterrupt):
        first.group("b", lambda: rows("b"))
    again = Store(path, {"scene": 1})
    assert again.group("a", lambda: rows("a")) == [{"name": "a", "ms": 1.0}]
    again.group("b", lambda: rows("b"))
    assert calls == ["a", "b", "b"]
    assert Store(path, {"scene": 2}).groups == {}
    path.write_text("not JSON")
    assert Store(path, {"scene": 1}).groups == {}


def test_calls_take_turns():
    order = []

    def call(name):
        order.append(name)
        return dr.llvm.ad.Float([1.0, 2.0]) + len(order)

    found = in_turns({"a": lambda: call("a"), "b": lambda: call("b")}, rounds=3)
    assert order == ["a", "b"] + ["a", "b"] * 3 + ["a", "b"]
    np.testing.assert_array_equal(found["a"]["value"].numpy(), [2, 3])
    assert found["a"]["ms"] > 0
    assert found["a"]["spread"] >= 0


def test_front_keeps_what_nothing_betters():
    rows = [
        {"ms": 1, "error": 0.5},
        {"ms": 2, "error": 0.6},
        {"ms": 3, "error": 0.1},
        {"ms": 2.5, "error": 0.3},
        {"error": 0.01},
    ]
    assert [row["ms"] for row in front(rows)] == [1, 2.5, 3]


def test_slope_is_the_exponent():
    rows = [{"x": n, "ms": 3 * n**1.5} for n in (1, 2, 4, 8)]
    assert slope(rows) == pytest.approx(1.5)
    assert np.isnan(slope(rows[:1]))


def test_chart_refuses_bad_input(scene, tmp_path, capsys, monkeypatch):
    assert run(["chart", str(tmp_path / "none.toml"), "-o", str(tmp_path / "c")]) == 2
    assert run(["chart", str(scene), "-o", str(tmp_path / "no" / "such")]) == 2
    assert run(["chart", str(scene), "-o", str(tmp_path / "c"), "--size", "big"]) == 2
    text = capsys.readouterr().err
    assert all(
        part in text
        for part in ("cannot be read", "there is no folder", "--size: expected WIDTHxHEIGHT")
    )
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    assert run(["chart", str(scene), "-o", str(tmp_path / "c")]) == 2
    assert "pip install 'whitted[fit]'" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()
