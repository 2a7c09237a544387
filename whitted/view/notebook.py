"""`view`: the page in a cell of a notebook, and a Python object."""

from functools import cache
from typing import TYPE_CHECKING, Any

from ..scene.scene import Scene, checked_scene

if TYPE_CHECKING:
    from .session import Session


def view(scene: Scene) -> Any:
    """Show a scene in a notebook, to be moved and differentiated with the mouse.

    The cell has the picture, the sliders and the derivatives of the page that the command
    `whitted view` serves; it has no fits, and saves nothing.

    Returns:
        A widget of the library anywidget. Its attribute `scene` is the scene as it is now: what the
        mouse has made of it, or what Python gives it.

    Raises:
        TypeError: no scene is given, but its name, say.
        ValueError: the scene's pictures are too large to be looked at.
        RuntimeError: anywidget is missing.

    Example:
        >>> view = whitted.view(whitted.load_scene("cornell"))
        >>> view
        >>> view.scene.save("moved.toml")
    """
    return _view_class()(checked_scene(scene))


@cache
def _view_class() -> type:
    """The class of widgets: made when it is first needed, as it needs the library."""
    try:
        from anywidget import AnyWidget
    except ImportError:
        raise RuntimeError(
            "a view in a notebook needs anywidget, which is missing; "
            "install it with: pip install 'whitted[notebook]'"
        ) from None
    from .bundle import STATIC, bundled
    from .session import Session

    class View(AnyWidget):
        """A scene that is shown in a notebook."""

        _esm = bundled("widget.js")
        _css = (STATIC / "style.css").read_text(encoding="utf-8")

        def __init__(self, scene: Scene) -> None:
            self._session = Session(scene)
            super().__init__()
            self.on_msg(lambda widget, message, buffers: _take(widget, self._session, message))

        @property
        def scene(self) -> Scene:
            """The scene as it is now."""
            return self._session.state.scene

        @scene.setter
        def scene(self, scene: Scene) -> None:
            self._session = Session(checked_scene(scene))
            _take(self, self._session, {"kind": "open"})

        def __repr__(self) -> str:
            return f"View of {self.scene!r}"

    return View


def _take(widget: Any, session: "Session", message: Any) -> None:
    """Do what the widget's page says, and show it what has changed."""
    try:
        for reply in session.handle(message):
            widget.send(reply)
        if session.state.stale:
            header, shown = session.frame()
            widget.send({**header, "pictures": list(shown)}, list(shown.values()))
    except Exception as error:
        widget.send(session.failed(error))
