"""`view`: a widget that shows a scene in a notebook, and has it as a Python object."""

import sys
from importlib.util import find_spec

import pytest
from view_scene import TEXT

import whitted as wt
from whitted.view.bundle import STATIC, bundled

needs_anywidget = pytest.mark.skipif(
    find_spec("anywidget") is None,
    reason="needs anywidget: pip install 'whitted[notebook]'",
)
RADIUS = "spheres.ball.radius"


class Cell:
    """A widget, and what it sends to its page."""

    def __init__(self, scene):
        self.view = wt.view(scene)
        self.sent = []
        self.view.send = lambda message, buffers=None: self.sent.append((message, buffers or []))

    def says(self, kind, **more):
        """The page says something; returns what it is sent."""
        self.sent.clear()
        # As ipywidgets does when a message comes
        self.view._handle_custom_msg({"kind": kind, **more}, [])
        return [message["kind"] for message, _ in self.sent]


@pytest.fixture
def cell():
    return Cell(wt.parse_scene(TEXT))


@needs_anywidget
def test_messages_change_the_scene_of_the_object(cell):
    before = cell.view.scene
    assert cell.says("open") == ["scene", "frame"]
    header, (picture,) = cell.sent[1]
    assert header["pictures"] == ["picture"]
    assert picture.startswith(b"\xff\xd8")
    assert cell.says("set", name=RADIUS, value=[0.5]) == ["frame"]
    assert cell.view.scene.numbers[RADIUS] == (0.5,)
    assert cell.view.scene == before.replace({RADIUS: 0.5})
    assert cell.says("keep") == ["frame"]
    assert cell.says("undo") == ["frame"]
    assert cell.view.scene == before
    assert cell.says("rest") == ["frame"]
    assert cell.says("rest") == []


@needs_anywidget
def test_scene_of_the_object_is_shown(cell):
    scene = wt.parse_scene(TEXT).remove("discs.mirror")
    cell.sent.clear()
    cell.view.scene = scene
    assert cell.view.scene is scene
    (told, _), (frame, _) = cell.sent
    assert "discs.mirror" not in [group["name"] for group in told["groups"]]
    assert frame["values"] == {}
    assert repr(cell.view) == f"View of {scene!r}"


@needs_anywidget
def test_refusals_and_errors_are_told(cell, monkeypatch):
    assert cell.says("set", name=RADIUS, value=[-1]) == ["refused", "frame"]

    def fails(*_):
        raise OSError("no such thing")

    monkeypatch.setattr(cell.view._session, "frame", fails)
    assert cell.says("set", name=RADIUS, value=[0.5]) == ["refused"]
    assert cell.sent[0][0]["text"].endswith("the last step is taken back: no such thing")


@needs_anywidget
def test_only_scenes_are_shown(cell):
    with pytest.raises(TypeError, match="expected a Scene, got 'cornell'"):
        wt.view("cornell")
    with pytest.raises(TypeError, match="expected a Scene, got 'cornell'"):
        cell.view.scene = "cornell"
    large = wt.parse_scene(TEXT).replace({"camera.resolution": (4000, 4000)})
    with pytest.raises(ValueError, match="4000 x 4000 has more than 4194304 pixels"):
        wt.view(large)


def test_missing_library_is_named(monkeypatch):
    from whitted.view import notebook

    notebook._view_class.cache_clear()
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(RuntimeError, match=r"install it with: pip install 'whitted\[notebook\]'"):
        wt.view(wt.parse_scene(TEXT))
    notebook._view_class.cache_clear()


def test_bundle_has_every_script_once_and_no_imports():
    text = bundled("widget.js")
    used = {path.name for path in STATIC.glob("*.js")} - {"main.js", "socket.js", "widget.js"}
    for name in used:
        assert text.count(f'modules["{name}"] = ') == 1
        # Before it is used
        assert text.index(f'modules["{name}"] = ') < text.index(f'= modules["{name}"]')
    assert "\nimport " not in text
    assert text.count("\nexport ") == 1
