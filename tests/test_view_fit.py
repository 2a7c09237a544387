"""Fits of a page: in a process of their own, stopped, killed, and refused."""

import base64
import pickle
import queue

import numpy as np
import pytest
from drjit.llvm.ad import TensorXf
from view_scene import TEXT

import whitted as wt
from whitted.view.serving import Opening
from whitted.view.session import Session

CENTER = "spheres.ball.center"
# Seconds until an event of the process: it starts Python, and compiles kernels
PATIENCE = 60


@pytest.fixture
def session(tmp_path):
    session = Session(wt.parse_scene(TEXT), tmp_path)
    session.events = queue.Queue()
    session.state.post = session.events.put
    yield session
    session.close()


def say(session, kind, **more):
    return session.handle({"kind": kind, **more})


def started(session, *wrt):
    """Take the picture as the target, move the ball, and start a fit."""
    (target,) = say(session, "target", source="now")
    assert target["size"] == [48, 32]
    assert base64.b64decode(target["picture"]).startswith(b"\xff\xd8")
    say(session, "set", name=CENTER, value=[0.5, 0.05, 0.5])
    say(session, "keep")
    (reply,) = say(session, "fit", wrt=list(wrt or [CENTER]))
    assert reply["kind"] == "fitting"


def replies(session):
    """What a page is told, until the fit has ended."""
    told = []
    while not told or told[-1]["kind"] == "step":
        told += session.on_event(session.events.get(timeout=PATIENCE))
    return told


def test_fit_finds_the_ball_and_its_result_is_the_scene(session):
    started(session)
    assert say(session, "undo")[0]["text"] == "undo: a fit is running; stop it first"
    assert session.take_target("a.png", b"")[0]["text"].startswith("target: a fit is running")
    told = replies(session)
    assert [each["kind"] for each in told] == ["step"] * (len(told) - 1) + ["fitted"]
    losses = [each["loss"] for each in told[:-1] if each["size"] == (48, 32)]
    assert losses[-1] < 1e-3 * losses[0]
    labels, values, deviations = zip(*told[-1]["numbers"], strict=True)
    assert labels == tuple(f"{CENTER}.{axis}" for axis in "xyz")
    np.testing.assert_allclose(values, (0.6, 0, 0.5), atol=2e-3)
    assert max(deviations) < 0.01
    header, shown = session.frame()
    np.testing.assert_allclose(header["values"][CENTER], (0.6, 0, 0.5), atol=2e-3)
    assert "difference" in shown
    # The fit is one step back
    say(session, "undo")
    np.testing.assert_allclose(session.frame()[0]["values"][CENTER], (0.5, 0.05, 0.5), atol=1e-6)


def test_stopped_fit_keeps_the_best_and_goes_on(session):
    started(session)
    assert session.on_event(session.events.get(timeout=PATIENCE))[0]["kind"] == "step"
    say(session, "stop")
    (*_, last) = replies(session)
    assert last["kind"] == "fitted"
    assert last["summary"].startswith("interrupted")
    assert say(session, "fit", wrt=[CENTER])[0]["kind"] == "fitting"
    # Asked twice, it ends at once
    say(session, "stop")
    say(session, "stop")
    (*_, last) = replies(session)
    assert last["kind"] in ("failed", "fitted")


def test_killed_process_is_told(session):
    started(session)
    session.state.fitting.kill()
    (*_, last) = replies(session)
    assert last["kind"] == "failed"
    assert last["error"] == (
        "the process of the fit has ended (status -9); the scene is that of the last step"
    )
    assert session.state.fitting is None
    assert say(session, "undo") == []


def test_fit_that_is_refused_is_told(session):
    session.set_target(TensorXf(np.full((32, 48, 3), np.nan, np.float32)))
    say(session, "fit", wrt=[CENTER])
    (*_, last) = replies(session)
    assert last["kind"] == "failed"
    assert "target" in last["error"]
    assert "\n" not in last["error"]


def test_what_no_picture_tells_has_no_deviation(session):
    name = "materials.mirror.shininess"
    started(session, CENTER, name)
    (*_, last) = replies(session)
    unknown = {label: deviation for label, _, deviation in last["numbers"]}[name]
    assert unknown is None
    assert any(f"do not depend on {name}" in note for note in last["notes"])


def test_unknown_parameters_are_refused(session):
    say(session, "target", source="now")
    (reply,) = say(session, "fit", wrt=["spheres.bal.center"])
    assert reply["text"] == "fit: the scene has no parameter 'spheres.bal.center'"
    (reply,) = say(session, "fit", wrt=[])
    assert reply["text"].startswith("fit.wrt: list should have at least 1 item")


def test_no_target(session):
    say(session, "target", source="now")
    (reply,) = say(session, "target", source="none")
    assert (reply["size"], reply["picture"]) == (None, None)
    assert "difference" not in session.frame()[1]


def test_target_sets_the_size_of_pictures(session):
    session.set_target(wt.render(session.state.scene, resolution=(30, 20)))
    assert session.frame()[0]["look"]["size"] == [30, 20]
    kinds = [reply["kind"] for reply in say(session, "open")]
    assert kinds == ["scene", "target"]
    # Of another size, nothing is compared
    look = session.state.look.model_copy(update={"size": [12, 8]})
    session.handle(look.model_dump())
    say(session, "rest")
    assert "difference" not in session.frame()[1]


def test_target_of_the_command_is_there_from_the_start(tmp_path):
    """What the command opens is sent to the server's process."""
    scene = wt.parse_scene(TEXT)
    image = wt.render(scene, resolution=(30, 20)).numpy()
    opening = pickle.loads(pickle.dumps(Opening(scene, tmp_path, "a.toml", image)))
    session = opening.session()
    assert [reply["kind"] for reply in say(session, "open")] == ["scene", "target"]
    np.testing.assert_array_equal(session.state.target.numpy(), image)
    say(session, "rest")
    header, shown = session.frame()
    assert "difference" in shown
    assert header["look"]["size"] == [30, 20]
    # The comments of the file have come along
    say(session, "save", name="b.toml")
    assert "# before the mirror" in (tmp_path / "b.toml").read_text()
