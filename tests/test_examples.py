"""Every example runs, and finds what it says that it finds, in tiny pictures."""

import re
import runpy
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"
# A coarse picture tells less: errors in units of the number's own size, and pictures of at least
# this size where needed
ALLOWED = {
    "camera_pose": (48, 0.01),
    "glass_ball": (48, 0.01),
    "glass_index": (48, 0.002),
    "light": (48, 0.01),
    "mirror_only": (48, 0.01),
    "noise": (32, 0.15),
    "no_slope": (48, 0.01),
    "shadow_only": (48, 0.01),
}
LINE = re.compile(r"^(\S+) +(-?[\d.]+) +(-?[\d.]+) +(-?[\d.]+) +(\S+) +(\S+)$", re.M)


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """A function that runs an example as a script, and returns what it printed."""

    def run(name, size):
        monkeypatch.setattr(sys, "argv", [f"{name}.py", "--size", str(size), "-o", str(tmp_path)])
        monkeypatch.syspath_prepend(str(EXAMPLES))
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        return capsys.readouterr().out

    return run


def test_all_examples_are_tested():
    scripts = {path.stem for path in EXAMPLES.glob("*.py")}
    assert scripts == {*ALLOWED, "common", "with_torch", "mitsuba_target", "mitsuba_position"}


@pytest.mark.parametrize("name", ALLOWED)
def test_example_recovers_its_scene(name, run, tmp_path):
    size, allowed = ALLOWED[name]
    text = "\n" + run(name, size)
    rows = LINE.findall(text[text.rindex("\n\n") :])
    assert rows
    for label, true, start, found, *_ in rows:
        # How far away what the camera looks at is cannot be told
        if label not in ("camera.look_at.y", "camera.look_at.z"):
            off = abs(float(found) - float(true))
            assert off < allowed * max(1, abs(float(true)))
            assert off < 0.5 * abs(float(start) - float(true)) or float(start) == float(true)
    assert {path.suffix for path in tmp_path.iterdir()} == {".png"}
    if name == "noise":
        error_bars_cover_the_truth(text)
    if name == "no_slope":
        one_start_fails(text)


def error_bars_cover_the_truth(text):
    errors = [
        float(number)
        for line in re.findall(r"deviations: \[(.*)\]", text)
        for number in line.split()
    ]
    # Of twelve numbers from normal distributions one is beyond 4 in 1 of 1300 runs
    assert len(errors) == 12
    assert max(map(abs, errors)) < 4
    assert max(map(abs, errors)) > 0.5


def one_start_fails(text):
    first = LINE.findall(text[: text.index("No overlap, coarse")])
    assert abs(float(first[0][3]) - float(first[0][1])) > 1


def test_torch_loss(run):
    pytest.importorskip("torch")
    found = float(re.search(r"found ([\d.]+)", run("with_torch", 32))[1])
    assert abs(found - 1.5) < 0.02
