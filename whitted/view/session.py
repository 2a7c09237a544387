"""A session: messages go in, replies and frames come out."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core.arrays import Array
from ..rendering.pick import pick
from ..scene.scene import Scene
from . import actions, messages, recovery
from .fitting import Event
from .pictures import Painter
from .saving import FileIsThereError
from .sliders import groups_of
from .state import State

Reply = dict[str, Any]


class Session:
    """A scene behind a page. One thread uses it at a time."""

    def __init__(self, scene: Scene, folder: Path = Path(), name: str = "scene.toml") -> None:
        """Open a scene.

        Args:
            folder: where it is saved.
            name: of its file.

        Raises:
            ValueError: its pictures are too large to be looked at.
        """
        self.state = State(scene, folder, name)
        self._painter = Painter()

    def handle(self, message: Any) -> list[Reply]:
        """Do what a page says.

        Args:
            message: as `messages.read` takes it.

        Returns:
            What to tell the page besides the next frame: dictionaries for JSON. One of the kind
            "refused" has a line that says what is wrong, and mostly what to do.
        """
        try:
            asked = messages.read(message)
            recovery.refuse_while_fitting(self.state, asked.kind)
            if asked.kind == "open":
                return self._opened()
            action = (actions.ACTIONS | recovery.ACTIONS)[asked.kind]
            return action(self.state, asked) or []
        except FileIsThereError as error:
            return [{"kind": "there", "text": str(error), "name": message["name"]}]
        except (ValueError, KeyError) as error:
            return [refusal(error)]

    def take_target(self, name: str, data: bytes) -> list[Reply]:
        """A page has sent the file of a target; the replies are as those of `handle`."""
        try:
            return recovery.take_target(self.state, name, data)
        except (ValueError, OSError) as error:
            return [refusal(error)]

    def set_target(self, image: Array) -> None:
        """Compare pictures with an image of shape (height, width, 3), linear RGB.

        Raises:
            ValueError: it is too large.
        """
        recovery.set_target(self.state, image)

    def on_event(self, event: Event) -> list[Reply]:
        """A fit has reported; the replies are as those of `handle`."""
        return recovery.on_event(self.state, event)

    def frame(
        self, interrupted: Callable[[], bool] = lambda: False
    ) -> tuple[Reply, dict[str, bytes]]:
        """What is to be seen now.

        Args:
            interrupted: asked between bands of rows whether to give up.

        Returns:
            Numbers for JSON, among them all "values" that differ from those of the scene as it was
            opened; and the pictures by name, as JPEG (`Painter.frame`).

        Raises:
            InterruptedPictureError: `interrupted` said so; the next frame is still to be made.
        """
        start, state = time.perf_counter(), self.state
        shown, scales = self._painter.frame(state.wanted(), interrupted)
        state.stale = False
        first, now = state.history.first.numbers, state.scene.numbers
        header: Reply = {
            "kind": "frame",
            "session": state.born,
            "values": {name: list(now[name]) for name in state.sizes if now[name] != first[name]},
            "picked": state.picked,
            "lights": state.lights(),
            "undo": state.history.can_undo,
            "redo": state.history.can_redo,
            "look": state.look.model_dump(exclude={"kind"}),
            "derivative": state.asked and state.asked.model_dump(exclude={"kind"}),
            "scales": scales,
            "moving": state.moving,
            "milliseconds": 1e3 * (time.perf_counter() - start),
        }
        return header, shown

    def warm(self) -> None:
        """Compile what the first picture and the first drag need, before there is a page."""
        state, (width, height) = self.state, self.state.look.size
        picked = 0 if state.scene.shapes else None
        self._painter.frame(replace(state.wanted(), picked=picked))
        pick(state.scene, width / 2, height / 2, resolution=(width, height))

    def failed(self, error: Exception) -> Reply:
        """After an error of ours, go back to what worked: the last step's scene, no derivative.

        Returns:
            What to tell the page.
        """
        state = self.state
        state.scene, state.asked, state.held = state.history.scene, None, None
        state.stale = False
        if isinstance(error, MemoryError):
            text = "not enough memory; choose a smaller size, or fewer samples"
        else:
            text = f"this did not work, and the last step is taken back: {error}"
        return {"kind": "refused", "text": text}

    def close(self) -> None:
        """End what runs beside."""
        if self.state.fitting:
            self.state.fitting.kill()

    def _opened(self) -> list[Reply]:
        """All that a page needs to begin with."""
        state = self.state
        state.change()
        scene = {
            "kind": "scene",
            "name": state.name,
            "session": state.born,
            "groups": groups_of(state.history.first),
            "fitting": state.fitting is not None,
        }
        return [scene] if state.target is None else [scene, recovery.told_target(state)]


def refusal(error: Exception) -> Reply:
    """What a page is told of a message that is refused."""
    return {"kind": "refused", "text": str(error.args[0] if error.args else error)}
