"""The progress bar: who gets one, and when it is drawn."""

import io
import threading
import time

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
def at_once(monkeypatch):
    """A bar need not wait."""
    monkeypatch.setattr(progress, "DELAY", 0)


def wait_for(screen, text):
    """Work on, without a report, until the screen shows a text; a bar is drawn ten times a second.

    A machine that is busy gets a minute.
    """
    end = time.monotonic() + 60
    while text not in screen.getvalue():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_bar_appears_within_a_second_without_a_report(screen):
    """As while the first kernels are compiled."""
    assert progress.DELAY < 1
    with progress_bar("working"):
        assert screen.getvalue() == ""
        wait_for(screen, "working")
        assert "100%" not in screen.getvalue()
    # The line is cleared, and the cursor is there again
    assert screen.getvalue().endswith("\x1b[?25h\r\x1b[1A\x1b[2K")


def test_bar_shows_what_is_done(screen, at_once):
    with progress_bar("working") as report:
        report(0.25)
        wait_for(screen, "25%")
        report(0.5)
        wait_for(screen, "50%")


def test_what_is_quick_has_no_bar(screen):
    with progress_bar("working") as report:
        report(0.5)
    threads = [thread for thread in threading.enumerate() if isinstance(thread, threading.Timer)]
    assert (screen.getvalue(), threads) == ("", [])


def test_error_takes_the_bar_away(screen, at_once):
    def interrupted():
        with progress_bar("working"):
            wait_for(screen, "working")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert screen.getvalue().endswith("\x1b[?25h\r\x1b[1A\x1b[2K")


def test_no_bar_without_a_terminal(capsys, at_once):
    with progress_bar("working") as report:
        report(0.5)
        time.sleep(0.1)
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


def test_render_and_gradient_show_a_bar(load, screen, at_once):
    scene, options = load(SCENES["all"]), {"boundary": False, "resolution": (8, 12)}
    wt.render(scene, progress=True, **options)
    assert "rendering" in screen.getvalue()
    wt.gradient(scene, "camera.fov", progress=True, **options)
    assert "differentiating" in screen.getvalue()
    with pytest.raises(ValueError, match="progress: expected True, False or a function"):
        wt.render(scene, progress="yes", **options)


def test_derivatives_after_the_image_draw_nothing(load, screen, at_once):
    """Whatever is computed once the call is over has no bar, and leaves none on the screen."""
    parameters = load(SCENES["all"]).parameters("camera.fov")
    dr.enable_grad(parameters)
    scene = load(SCENES["all"]).replace(parameters)
    image = wt.render(scene, boundary=False, resolution=(8, 12), progress=True)
    drawn = screen.getvalue()
    dr.backward(dr.sum(image, axis=None))
    time.sleep(0.2)
    assert screen.getvalue() == drawn


def test_progress_is_by_work(load, monkeypatch):
    """Parts of the search for edges cost about the same, and each counts for as much."""
    monkeypatch.setattr("whitted.edges.settings.SEARCHED", 100)
    done = []
    wt.render(load(SCENES["all"]), resolution=(24, 24), progress=done.append)
    assert len(done) > 3
    assert done == pytest.approx([(k + 1) / len(done) for k in range(len(done))])
