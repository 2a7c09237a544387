"""The progress bar: who gets one, and when it is drawn."""

import io
import itertools
from types import SimpleNamespace

import drjit as dr
import pytest
from rich.console import Console
from samples import SCENES

import whitted as wt
from whitted.files import progress
from whitted.files.progress import progress_bar, reporting


@pytest.fixture
def screen(monkeypatch):
    """What a terminal shows, which takes the place of standard error."""
    screen = io.StringIO()
    monkeypatch.setattr(
        "rich.console.Console", lambda stderr: Console(file=screen, force_terminal=True, width=80)
    )
    return screen


@pytest.fixture
def clock(monkeypatch):
    """A list whose only entry is the time that the bar sees."""
    now = [0.0]
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: now[0]))
    return now


def test_bar_appears_after_a_second(screen, clock):
    with progress_bar("working") as report:
        report(0.25)
        assert screen.getvalue() == ""
        clock[0] = 1.5
        report(0.5)
        assert "working" in screen.getvalue()


def test_no_bar_without_a_terminal(capsys, clock):
    with progress_bar("working") as report:
        clock[0] = 1.5
        report(0.5)
    assert capsys.readouterr() == ("", "")


def test_what_progress_may_be():
    seen = []
    for given in (None, False):
        with reporting(given, "working") as report:
            assert report is None
    with reporting(seen.append, "working") as report:
        report(0.5)
    assert seen == [0.5]
    with (
        pytest.raises(ValueError, match=r"progress: expected True, False or a function .* got 3"),
        reporting(3, "working"),
    ):
        pass


def test_render_and_gradient_show_a_bar(load, screen, monkeypatch):
    """An image of three bands, between which a second goes by."""
    monkeypatch.setattr("whitted.rendering.job.BAND", 32)
    seconds = SimpleNamespace(monotonic=itertools.count().__next__)
    monkeypatch.setattr(progress, "time", seconds)
    scene, options = load(SCENES["all"]), {"boundary": False, "resolution": (8, 12)}
    wt.render(scene, progress=True, **options)
    assert "rendering" in screen.getvalue()
    wt.gradient(scene, "camera.fov", progress=True, **options)
    assert "differentiating" in screen.getvalue()
    with pytest.raises(ValueError, match="progress: expected True, False or a function"):
        wt.render(scene, progress="yes", **options)


def test_derivatives_after_the_image_draw_nothing(load, screen, clock):
    """Whatever is computed once the call is over has no bar, and leaves none on the screen."""
    parameters = load(SCENES["all"]).parameters("camera.fov")
    dr.enable_grad(parameters)
    scene = load(SCENES["all"]).replace(parameters)
    image = wt.render(scene, boundary=False, resolution=(8, 12), progress=True)
    clock[0] = 1.5
    dr.backward(dr.sum(image, axis=None))
    assert screen.getvalue() == ""
