"""The stress suite: each case passes, and what is wrong is noticed and reported."""

import base64
import csv
import re
import sys

import numpy as np
import pytest

from whitted.cli import run
from whitted.core.arrays import PRECISIONS
from whitted.stress import interface, report, suite
from whitted.stress.case import Case, Chart, Check, Curve
from whitted.stress.report import break_index, describe_break


@pytest.mark.parametrize("precision", PRECISIONS, ids=lambda precision: precision.name)
@pytest.mark.parametrize("case", suite.CASES, ids=suite.slug)
def test_case(case, precision):
    checks = list(case.checks(precision))
    assert checks
    assert [check for check in checks if not check.passed] == []


def test_every_case_of_the_list_is_there():
    assert [case.number for case in suite.CASES] == list(range(1, 32))
    assert len({suite.slug(case) for case in suite.CASES}) == 31


@pytest.mark.parametrize(
    "case", [case for case in suite.CASES if case.number in (1, 11, 14, 18)], ids=suite.slug
)
def test_charts_show_where_methods_break(case):
    """One method or precision breaks; another does not, or breaks elsewhere."""
    chart = case.chart()
    breaks = [describe_break(curve, chart) for curve in chart.curves]
    assert any("breaks" in text for text in breaks)
    assert len({text.partition(":")[2] for text in breaks}) > 1


def test_report(tmp_path, capsys):
    assert run(["stress", "9", "brewster-angle", "tangent-ray", "-o", str(tmp_path / "out")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1:-1]] == ["1", "1", "9", "9", "10", "10"]
    assert "6 results, 0 failed" in lines[-1]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "1. tangent ray" in page
    picture = (tmp_path / "out" / "01-tangent-ray.png").read_bytes()
    assert f'src="data:image/png;base64,{base64.b64encode(picture).decode()}"' in page
    assert page.count("src=") == 1
    assert not re.search(r"href=|url\(|@import", page)
    assert 'name="viewport" content="width=device-width' in page
    assert page.count("<table>") == page.count('<div class="wide"><table>') > 0
    assert '<span class="pass">all pass</span>' in page
    assert picture.startswith(b"\x89PNG")
    names = {"01-tangent-ray.png", "results.csv", "report.html"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    with (tmp_path / "out" / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["number"] for row in rows} == {"1", "9", "10"}
    assert {row["result"] for row in rows} == {"pass"}


def test_text_is_escaped_in_the_report(tmp_path):
    (tmp_path / "1.png").touch()
    case = Case(1, "a<b>", "t > 0 & t < 1", "<i>", lambda precision: (), limit="'&'")
    checks = Check("x < y", 0, 1), Check("p & q", 2, 1)
    plots = {1: report.Plot(tmp_path / "1.png", ['"t" > 0: holds', "a&b: holds"])}
    page = report.report([suite.Result(case, "single", checks, 0.0)], plots)
    for text in (
        "1. a&lt;b&gt;</h2>",
        "t &gt; 0 &amp; t &lt; 1",
        "&lt;i&gt;",
        "&#39;&amp;&#39;",
        "x &lt; y</td>",
        "p &amp; q</td>",
        'alt="&#34;t&#34; &gt; 0: holds; a&amp;b: holds"',
        "<details open>",
    ):
        assert text in page
    assert "<i>" not in page


def test_failure_is_reported(tmp_path, capsys, monkeypatch):
    """A reflectance that is off by 1e-4 fails in both precisions, and so does the command."""
    right = interface.fresnel
    monkeypatch.setattr(interface, "fresnel", lambda *args: right(*args) * 1.0001)
    assert run(["stress", "9", "-o", str(tmp_path / "out")]) == 1
    output = capsys.readouterr().out
    assert output.count("FAIL") == 6  # a value and two derivatives, in two precisions
    assert "2 results, 2 failed" in output
    page = (tmp_path / "out" / "report.html").read_text()
    assert '<span class="FAIL">2 failed</span>' in page
    assert page.count("<details open>") == 2


def test_case_that_raises_fails():
    def broken(precision):
        yield Check("first", 0, 0)
        raise ZeroDivisionError("by zero")

    results = suite.run([Case(1, "broken", "", "", broken)])
    assert [result.passed for result in results] == [False, False]
    assert results[0].tightest.what == "ZeroDivisionError: by zero"


@pytest.mark.parametrize(
    ("error", "bound", "passed"),
    [(0, 0, True), (1, 2, True), (2, 1, False), (np.nan, 1, False), (1, 0, False)],
)
def test_check(error, bound, passed):
    check = Check("", error, bound)
    assert check.passed == passed
    assert (check.ratio <= 1) == passed


@pytest.mark.parametrize(
    ("errors", "index", "text"),
    [
        ([1e-3, 1e-3], None, "holds"),
        ([1e-3, 1e-3, 1, 1e-3, 1], 2, "breaks at 3"),
        ([1, 1, 1e-3], 1, "breaks at 2"),
        ([1e-3, np.nan], 1, "breaks at 2"),
        ([1, np.inf], 0, "broken throughout"),
    ],
)
def test_where_a_method_breaks(errors, index, text):
    curve = Curve("it", np.arange(1, len(errors) + 1), np.array(errors))
    chart = Chart("", "", "", (curve,), 0.1)
    assert break_index(curve, chart) == index
    assert describe_break(curve, chart) == f"it: {text}"


def test_unknown_case(tmp_path, capsys):
    assert run(["stress", "brewster", "-o", str(tmp_path / "out")]) == 2
    assert "there is no stress case 'brewster'; nearest: brewster-angle" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_folder_that_is_a_file(tmp_path, capsys):
    (tmp_path / "out").write_text("")
    assert run(["stress", "9", "-o", str(tmp_path / "out")]) == 2
    assert "is a file; name a folder" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["01-tangent-ray.png", "results.csv", "report.html"])
def test_file_that_cannot_be_written_is_found_before_a_case_runs(
    tmp_path, capsys, monkeypatch, name
):
    monkeypatch.delattr(suite, "run")
    (tmp_path / name).mkdir()
    assert run(["stress", "1", "-o", str(tmp_path)]) == 2
    assert f"{name}: is a folder; name a file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("module", "command"),
    [
        ("matplotlib.figure", "pip install 'whitted[fit]'"),
        ("jinja2", "pip install 'whitted[bench]'"),
    ],
)
def test_missing_libraries(tmp_path, capsys, monkeypatch, module, command):
    monkeypatch.setitem(sys.modules, module, None)
    assert run(["stress", "9", "-o", str(tmp_path / "out")]) == 2
    assert command in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
