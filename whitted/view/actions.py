"""What each message does, but for those of fits (`recovery.py`)."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..files.images import write_image
from . import messages, mouse, saving
from .picking import picked_at
from .pictures import checked_size, sharp
from .sliders import groups_of
from .state import State

Reply = dict[str, Any]


def set_parameter(state: State, asked: messages.Set) -> None:
    value = asked.value if len(asked.value) > 1 else asked.value[0]
    state.replace({asked.name: value})


def prepare(state: State, asked: messages.Prepare) -> None:
    state.touch([asked.name])


def grab(state: State, asked: messages.Grab) -> None:
    name, depth = picked_at(state.scene, asked, state.look)
    state.held = mouse.Grabbed(state.scene, asked.x, asked.y, name, depth)
    if asked.what != "camera" and name != state.picked:
        state.picked = name
        state.change()


def drag(state: State, asked: messages.Drag) -> None:
    if state.held is None:
        raise ValueError("drag: nothing is held; press the button first")
    if state.held.how not in (None, asked.how):
        state.held = _taken_again(state, state.held)
    values = mouse.dragged(state.held, asked.x, asked.y, asked.how, state.aspect)
    state.replace(values)
    state.held = replace(state.held, how=asked.how, last=(asked.x, asked.y))


def _taken_again(state: State, held: mouse.Grabbed) -> mouse.Grabbed:
    """What is held, as if it were taken now: a key has changed what the mouse does with it."""
    before, now = (
        mouse.place_of(scene.numbers, held.name or "") for scene in (held.scene, state.scene)
    )
    depth = held.depth
    if before is not None and now is not None:
        forward = mouse.view_of(state.scene, state.aspect).forward
        depth += float(np.subtract(now, before) @ forward)
    return mouse.Grabbed(state.scene, *held.last, held.name, depth)


def wheel(state: State, asked: messages.Wheel) -> None:
    name = None if asked.camera else state.picked
    state.replace(mouse.wheeled(state.scene, name, asked.steps))


def select(state: State, asked: messages.Select) -> None:
    known = {own["name"] for own in groups_of(state.scene)}
    if asked.name is not None and asked.name not in known:
        raise ValueError(f"select: the scene has nothing called '{asked.name}'")
    state.picked = asked.name
    state.change()


def keep(state: State, _: messages.Keep) -> None:
    state.held = None
    state.history.keep(state.scene)
    # The page learns that there is something to undo
    state.stale = True


def step(state: State, asked: messages.Step) -> None:
    state.held, history = None, state.history
    if asked.kind == "undo":
        history.undo()
    elif asked.kind == "redo":
        history.redo()
    else:
        history.keep(history.first)
    state.scene = history.scene
    state.change()


def look(state: State, asked: messages.Look) -> None:
    checked_size(asked.size[0], asked.size[1])
    if math.isqrt(asked.spp) ** 2 != asked.spp:
        raise ValueError(f"look.spp: expected a perfect square (1, 4, 9, ...), got {asked.spp}")
    state.look = asked
    state.change()


def differentiate(state: State, asked: messages.Differentiate) -> None:
    if asked.name is not None:
        count = state.sizes.get(asked.name)
        if count is None:
            raise ValueError(f"differentiate: the scene has no parameter '{asked.name}'")
        if (count == 3) != (asked.component is not None):
            needs = "one of x, y, z" if count == 3 else "none"
            raise ValueError(f"differentiate.component: '{asked.name}' needs {needs}")
        state.touch([asked.name])
    state.asked = None if asked.name is None else asked
    state.change()


def rest(state: State, _: messages.Rest) -> None:
    if state.moving and state.fitting is None:
        state.change(moving=False)


def save(state: State, asked: messages.Save) -> list[Reply]:
    path = saving.path_of(state.folder, asked.name, asked.replace)
    if path.suffix.lower() == ".toml":
        saving.written(path, state.scene.save)
    else:
        image = sharp(state.scene, state.look, state.look.spp)
        saving.written(path, lambda own: write_image(own, image))
    return [{"kind": "saved", "text": f"saved {path.name}", "name": path.name}]


# What each kind of message does. Its replies are for pages, besides the next frame
ACTIONS: dict[str, Callable[[State, Any], list[Reply] | None]] = {
    "set": set_parameter,
    "prepare": prepare,
    "grab": grab,
    "drag": drag,
    "wheel": wheel,
    "select": select,
    "keep": keep,
    "undo": step,
    "redo": step,
    "reset": step,
    "look": look,
    "differentiate": differentiate,
    "rest": rest,
    "save": save,
}
