"""What the messages of fits do: targets, start, stop, and what a fit reports."""

import base64
from collections.abc import Callable
from typing import Any

import drjit as dr

from ..core.arrays import Array
from . import messages
from .colors import picture
from .fitting import SPP, Event, Fitting
from .pictures import jpeg, sharp
from .state import State
from .targets import checked, received

Reply = dict[str, Any]
# Messages that change what a fit works on
CHANGES = ("set", "prepare", "grab", "drag", "wheel", "undo", "redo", "reset", "target", "fit")


def refuse_while_fitting(state: State, kind: str) -> None:
    """Refuse a message that would change what a fit works on.

    Raises:
        ValueError: a fit is running.
    """
    if state.fitting is not None and kind in CHANGES:
        raise ValueError(f"{kind}: a fit is running; stop it first")


def take_target(state: State, name: str, data: bytes) -> list[Reply]:
    """A page has sent the file of a target.

    Raises:
        ValueError: it is no picture, or a fit is running.
    """
    refuse_while_fitting(state, "target")
    return set_target(state, received(name, data))


def set_target(state: State, image: Array | None) -> list[Reply]:
    """Compare pictures with a target from now on; they get its size."""
    if image is not None:
        size = list(checked(image, "target").shape[1::-1])
        state.look = state.look.model_copy(update={"size": size})
    state.target = image
    state.change(moving=False)
    return [told_target(state)]


def told_target(state: State) -> Reply:
    """What a page is told of the target."""
    if state.target is None:
        return {"kind": "target", "size": None, "picture": None}
    data = base64.b64encode(jpeg(picture(state.target, None))).decode()
    return {"kind": "target", "size": list(state.target.shape[1::-1]), "picture": data}


def target(state: State, asked: messages.Target) -> list[Reply]:
    now = asked.source == "now"
    return set_target(state, sharp(state.scene, state.look, SPP) if now else None)


def start(state: State, asked: messages.Fit) -> list[Reply]:
    if state.target is None:
        raise ValueError(
            "fit: there is no target; drop a picture here, or take the one that is now"
        )
    unknown = [name for name in asked.wrt if name not in state.sizes]
    if unknown:
        raise ValueError(f"fit: the scene has no parameter '{unknown[0]}'")
    state.touch(asked.wrt)
    height, width, _ = state.target.shape
    options = {"wrt": asked.wrt, "spp": SPP, "max_depth": state.look.depth}
    options["resolution"] = (width, height)
    state.held, state.look = None, state.look.model_copy(update={"size": [width, height]})
    pixels = dr.detach(state.target).numpy()
    state.fitting = Fitting(state.scene, pixels, options, lambda event: state.post(event))
    state.change()
    return [{"kind": "fitting", "wrt": asked.wrt}]


def stop(state: State, _: messages.Stop) -> None:
    if state.fitting is None:
        raise ValueError("stop: no fit is running")
    state.fitting.stop()


def on_event(state: State, event: Event) -> list[Reply]:
    """The process of a fit has reported: an iteration, its end, or its failure."""
    if state.fitting is None:
        return []
    ended = "error" in event or "summary" in event
    if "values" in event:
        state.scene = state.scene.replace(event["values"])
    if ended:
        state.fitting = None
        state.history.keep(state.scene)
    state.change(moving=not ended)
    kind = "failed" if "error" in event else "fitted" if ended else "step"
    return [{"kind": kind, **event}]


ACTIONS: dict[str, Callable[[State, Any], list[Reply] | None]] = {
    "target": target,
    "fit": start,
    "stop": stop,
}
