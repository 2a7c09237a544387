"""What the mouse takes, and how deep in the picture it is."""

import numpy as np

from ..rendering.pick import pick
from ..scene.scene import Scene
from . import messages, mouse


def picked_at(scene: Scene, asked: messages.Grab, look: messages.Look) -> tuple[str | None, float]:
    """The thing that is grabbed, None for the camera and for the background; and its depth.

    The depth is that of the point that is seen along the view. Of what is seen in a mirror it is
    that of the thing itself, as it moves there.

    Raises:
        ValueError: there is no such light.
    """
    if asked.what == "camera":
        return None, 0.0
    width, height = look.size
    view = mouse.view_of(scene, width / height)
    if asked.what == "light":
        place = mouse.place_of(scene.numbers, asked.name or "")
        if place is None or not (asked.name or "").startswith("lights."):
            raise ValueError(f"grab: the scene has no light '{asked.name}' that is at a point")
        return asked.name, max(mouse.projected(view, place)[2], 0.0)
    place_in_pixels = asked.x * width, asked.y * height
    found = pick(scene, *place_in_pixels, through=asked.through, resolution=(width, height))
    # The spheres of a cloud stay where they are
    if found is None or found.sphere is not None:
        return None, 0.0
    return found.name, abs(float((np.array(found.point) - view.eye) @ view.forward))
