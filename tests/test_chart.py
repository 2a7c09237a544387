"""The report of a small scene: all groups and files, and resumed runs."""

import base64
import itertools
import json
import re
import subprocess
import sys

import drjit as dr
import numpy as np
import pytest
from matplotlib.text import Text

from whitted.cli import run
from whitted.files.figures import figure_of, legend_below
from whitted.measure import plots, scaling
from whitted.measure.analysis import fastest, front, slope
from whitted.measure.chart import NAMES, chart, report
from whitted.measure.experiments import EXPERIMENTS
from whitted.measure.plots import Plot, draw_plots
from whitted.measure.point_labels import label_points
from whitted.measure.store import Store
from whitted.measure.timing import in_turns

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
    monkeypatch.setattr(scaling, "COUNTS", (1, 2, 4, 8))
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_report_has_all_groups_and_is_resumed(scene, tmp_path, capsys, monkeypatch):
    folder = tmp_path / "charts"
    assert run(["chart", str(scene), "-o", str(folder), "--quick", "--size", "24x24"]) == 0
    assert "wrote" in capsys.readouterr().out
    names = {path.name for path in folder.iterdir()}
    assert names == set(NAMES)
    assert {"image.csv", "memory.csv", "measured.json", "report.html", "limits.png"} <= names
    page = (folder / "report.html").read_text()
    check_page(page, folder, [name for name in names if name.endswith(".png")])
    assert "d image / d spheres.sphere0.center.x" in page
    stored = json.loads((folder / "measured.json").read_text())
    check_errors(stored["groups"])

    # All is measured: nothing is measured again, unless the conditions change
    def fail(*_):
        raise AssertionError

    release, done = stored["conditions"]["whitted"], []
    monkeypatch.setattr("whitted.measure.setup.in_turns", fail)
    chart(scene, folder, release, size=(24, 24), quick=True, progress=done.append)
    assert done == pytest.approx(np.arange(1, 12) / 11)
    with pytest.raises(AssertionError):
        chart(scene, folder, "another", size=(24, 24), quick=True)


def test_file_that_cannot_be_written_is_found_before_measuring(scene, tmp_path, capsys):
    (tmp_path / "charts" / "limits.png").mkdir(parents=True)
    assert run(["chart", str(scene), "-o", str(tmp_path / "charts")]) == 2
    assert "limits.png: is a folder; name a file" in capsys.readouterr().err
    assert len(list((tmp_path / "charts").iterdir())) == 1


def check_errors(groups):
    """More samples and edges lower the errors; the modes of differentiation agree."""
    rows = {row["name"]: row["error"] for row in groups["image"]}
    assert rows["boundary, spp 1"] < rows["plain, spp 4"] < rows["plain, spp 1"] < 1
    errors = {
        kind: [row["error"] for row in groups["gradient"] if row["kind"] == kind]
        for kind in ("boundary", "plain AD")
    }
    assert min(errors["boundary"]) < 0.1 < min(errors["plain AD"])
    modes = {row["name"]: row["error"] for row in groups["modes"]}
    forward = modes["boundary, forward, double, spp 1"]
    for which in ("one", "all"):
        reverse = modes[f"boundary, reverse, {which}, double, spp 1"]
        assert reverse == pytest.approx(forward, abs=1e-9)
        assert reverse < modes[f"plain AD, reverse, {which}, single, spp 1"]


def check_page(page, folder, pictures):
    """It needs no other file: all pictures are inside. It fits a narrow window."""
    sources = re.findall(r'src="data:image/png;base64,([^"]*)"', page)
    inside = {base64.b64decode(source) for source in sources}
    assert inside == {(folder / name).read_bytes() for name in pictures}
    assert page.count("src=") == len(sources)
    assert not re.search(r"href=|url\(|@import", page)
    assert 'name="viewport" content="width=device-width' in page
    assert page.count("<table>") == page.count('<div class="wide"><table>') > 0


def test_text_is_escaped_in_the_report(tmp_path):
    (tmp_path / "image.png").touch()
    groups = {"image": [{"name": "<b> & c", "ms": 1.0, "error": 0.5}], "depth": []}
    drawn = [Plot(tmp_path / "image.png", 'x < y & "z"')]
    page = report("a<b>&c", {"scene": "a<b>&c.toml"}, groups | {"importance": []}, drawn)
    for text in (
        "<title>a&lt;b&gt;&amp;c: speed against accuracy</title>",
        "<h1>a&lt;b&gt;&amp;c: ",
        ">a&lt;b&gt;&amp;c.toml</td>",
        "<td>&lt;b&gt; &amp; c</td>",
        'alt="x &lt; y &amp; &#34;z&#34;"',
    ):
        assert text in page
    assert "<b>" not in page


def test_interrupted_runs_are_resumed(tmp_path):
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


ROWS = [
    {"ms": 1, "error": 0.5},
    {"ms": 2, "error": 0.6},
    {"ms": 3, "error": 0.01},
    {"ms": 2.5, "error": 0.03},
    {"error": 0.001},
]


def test_front_has_the_rows_that_no_other_beats():
    assert [row["ms"] for row in front(ROWS)] == [1, 2.5, 3]


def test_fastest_row_of_each_error():
    assert [(error, row["ms"]) for error, row in fastest(ROWS)] == [
        (0.05, 2.5),
        (0.02, 3),
        (0.01, 3),
    ]


def test_slope_is_the_exponent():
    rows = [{"x": n, "ms": 3 * n**1.5} for n in (1, 2, 4, 8)]
    assert slope(rows) == pytest.approx(1.5)
    assert np.isnan(slope(rows[:1]))


def drawn(points, notes):
    """A plot of points with labels; returns the ends of labels, of points and of the panel."""
    figure, axes = figure_of(1, 5)
    axes.plot(*zip(*points, strict=True), "o", label="points")
    axes.set(xscale="log", yscale="log")
    legend_below(figure)
    label_points(figure, axes, points, notes)
    renderer = figure.canvas.get_renderer()
    texts = {text.get_text(): Text.get_window_extent(text, renderer) for text in axes.texts}
    places = axes.transData.transform(points)
    return texts, places, axes.get_window_extent(renderer), figure.legends[0]


def test_labels_cover_neither_points_nor_each_other():
    rng = np.random.default_rng(0)
    # Some are so close that their points overlap
    points = [(10**x, 10**y) for x, y in rng.normal(0, 0.1, (25, 2))] + [(1, 1.001), (1.001, 1)]
    notes = [f"step {k}, spp 4" for k in range(27)]
    texts, places, panel, legend = drawn(points, notes)
    assert list(texts) == notes
    for text, other in itertools.combinations(texts.values(), 2):
        assert not text.overlaps(other)
    for text in texts.values():
        assert not any(text.contains(*place) for place in places)
        assert panel.contains(text.x0, text.y0)
        assert panel.contains(text.x1, text.y1)
        assert not text.overlaps(legend.get_window_extent())
    assert not panel.overlaps(legend.get_window_extent())


def test_point_without_room_has_no_label():
    texts, *_ = drawn([(1, 1)], ["a label " * 30])
    assert texts == {}


def test_every_axis_says_what_it_is(tmp_path, monkeypatch):
    """And in which unit: in parentheses, unless it counts."""
    figures = []
    monkeypatch.setattr(plots, "_save", lambda path, figure: figures.append(figure))
    rows = [{"kind": kind, "name": f"{kind}, a"} for kind in ("plain AD", "boundary")]
    numbers = {"ms": 1, "spread": 0, "error": 1, "x": 1, "mib": 1, "compile_s": 0}
    rows = [row | numbers | {"depth": 1, "least": 0} for row in rows]
    draw_plots(tmp_path, dict.fromkeys(EXPERIMENTS, rows), "camera.fov")
    assert len(figures) == len(plots.FILES)
    for axes in (axes for figure in figures for axes in figure.axes):
        for label in (axes.get_xlabel(), axes.get_ylabel()):
            assert re.search(r"\(.*\)|^number of ", label)


def test_memory_of_the_parent_does_not_count():
    child = "from whitted.measure.scaling import peak_memory; print(peak_memory())"
    parent = (
        "import subprocess, sys; taken = b'x' * (1 << 29); "
        f"subprocess.run([sys.executable, '-c', {child!r}], check=True)"
    )
    done = subprocess.run([sys.executable, "-c", parent], capture_output=True, check=True)
    assert 10 < float(done.stdout) < 512


def test_bad_input_is_refused(scene, tmp_path, capsys):
    assert run(["chart", str(tmp_path / "none.toml"), "-o", str(tmp_path / "c")]) == 2
    assert run(["chart", str(scene), "-o", str(tmp_path / "no" / "such")]) == 2
    assert run(["chart", str(scene), "-o", str(tmp_path / "c"), "--size", "big"]) == 2
    text = capsys.readouterr().err
    messages = "cannot be read", "there is no folder", "--size: expected WIDTHxHEIGHT"
    assert all(message in text for message in messages)
    for size in ("0x0", "1000000x1000000"):
        assert run(["chart", str(scene), "-o", str(tmp_path / "c"), "--size", size]) == 2
        assert capsys.readouterr().err.startswith("--size: ")
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    ("module", "command"),
    [
        ("matplotlib.figure", "pip install 'whitted[fit]'"),
        ("jinja2", "pip install 'whitted[bench]'"),
    ],
)
def test_missing_libraries(scene, tmp_path, capsys, monkeypatch, module, command):
    monkeypatch.setitem(sys.modules, module, None)
    assert run(["chart", str(scene), "-o", str(tmp_path / "c")]) == 2
    assert command in capsys.readouterr().err
    assert not (tmp_path / "c").exists()
