"""From a scene to the pictures of a frame, as JPEG."""

import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array
from ..files.false_color import PERCENTILE
from ..rendering.gradient import gradient
from ..rendering.samples import render_samples
from ..scene.scene import Scene
from . import colors, marks
from .messages import PIXELS, Differentiate, Look

QUALITY = 90


class InterruptedPictureError(Exception):
    """Something else is to be shown."""


@dataclass(frozen=True)
class Wanted:
    """What a frame shows."""

    scene: Scene
    look: Look
    picked: int | None  # the number of the shape whose outline is drawn
    derivative: Differentiate | None
    moving: bool  # quickly, with one sample a pixel
    target: Array | None  # what the picture is compared with, of the same shape

    @property
    def options(self) -> dict[str, Any]:
        """What `render` is told."""
        edges = self.look.moving_edges if self.moving else self.look.edges
        return {
            "spp": 1 if self.moving else self.look.spp,
            "boundary": edges,
            "max_depth": self.look.depth,
            "resolution": tuple(self.look.size),
        }


class Painter:
    """Makes the pictures of frames. Scales of colours stay while something moves."""

    def __init__(self) -> None:
        self.scales: dict[str, tuple[Any, float]] = {}

    def frame(
        self, wanted: Wanted, interrupted: Callable[[], bool] = lambda: False
    ) -> tuple[dict[str, bytes], dict[str, float]]:
        """The pictures, by name, as JPEG; and the scales of those in false colours.

        "picture" is the scene, perhaps under its derivative; "derivative" is that beside it;
        "difference" is the picture less the target.

        Args:
            interrupted: asked between bands of rows whether to give up.

        Raises:
            InterruptedPictureError: it was.
            ValueError: what `render` refuses.
        """

        def check(_: float) -> None:
            if interrupted():
                raise InterruptedPictureError

        # A picture of one sample is over before it could be interrupted
        progress = None if wanted.moving else check
        image = render_samples(wanted.scene, progress=progress, **wanted.options)
        over = marks_of(wanted)
        shown: dict[str, bytes] = {}
        scales: dict[str, float] = {}
        asked = wanted.derivative
        if asked is None or asked.shown == "beside":
            shown["picture"] = jpeg(colors.picture(image, over))
        if asked is not None:
            slope = self._slope(wanted, asked, progress)
            key = asked.name, asked.component, asked.terms
            scales["derivative"] = scale = self._scale("derivative", key, slope, wanted.moving)
            below = image if asked.shown == "over" else None
            painted = jpeg(colors.derivative(slope, scale, below, over))
            shown["picture" if asked.shown == "over" else "derivative"] = painted
        if wanted.target is not None:
            gap = image - wanted.target
            scales["difference"] = scale = self._scale("difference", None, gap, wanted.moving)
            shown["difference"] = jpeg(colors.derivative(gap, scale, None, None))
        return shown, scales

    def _slope(self, wanted: Wanted, asked: Differentiate, progress: Any) -> Array:
        """The derivative. Edges are always searched, as they are its subject."""
        options = {**wanted.options, "boundary": True}
        name, component = asked.name or "", asked.component
        return gradient(
            wanted.scene, name, component, terms=asked.terms, progress=progress, **options
        )

    def _scale(self, name: str, key: Any, image: Array, moving: bool) -> float:
        """The percentile of an image's values that its colours end at, > 0."""
        known, scale = self.scales.get(name, (None, 0.0))
        if not (moving and known == key and scale):
            scale = _percentile(image)
            self.scales[name] = key, scale
        return scale


def _percentile(image: Array) -> float:
    with np.errstate(invalid="ignore"):
        sizes = abs(image.numpy().mean(-1))
    sizes = sizes[np.isfinite(sizes)]
    largest = float(np.percentile(sizes, PERCENTILE) or sizes.max()) if sizes.size else 0.0
    return largest if math.isfinite(1 / max(largest, 1e-30)) and largest > 1e-30 else 1.0


def marks_of(wanted: Wanted) -> Array | None:
    """What is drawn over the picture."""
    size, found = (wanted.look.size[0], wanted.look.size[1]), None
    if wanted.look.labels:
        found = marks.label_edges(wanted.scene, size, wanted.look.depth)
    if wanted.look.outline and wanted.picked is not None:
        own = marks.outline(wanted.scene, size, wanted.picked)
        found = own if found is None else found | own
    return found


def jpeg(pixels: np.ndarray) -> bytes:
    """Pixels of `colors.py` as JPEG, with colours at full resolution."""
    from PIL import Image

    memory = io.BytesIO()
    height, width, _ = pixels.shape
    picture = Image.frombuffer("RGBX", (width, height), pixels, "raw", "RGBX", 0, 1)
    picture.save(memory, "jpeg", quality=QUALITY, subsampling=0)
    return memory.getvalue()


def checked_size(width: int, height: int) -> tuple[int, int]:
    """A size of pictures that can be looked at.

    Raises:
        ValueError: too many pixels.
    """
    if width * height > PIXELS:
        raise ValueError(
            f"size: {width} x {height} has more than {PIXELS} pixels; choose a smaller one"
        )
    return width, height


def sharp(scene: Scene, look: Look, spp: int) -> Array:
    """The picture as it is saved, or fitted to: with the samples and edges that were asked for."""
    size = (look.size[0], look.size[1])
    image = render_samples(scene, spp, boundary=look.edges, max_depth=look.depth, resolution=size)
    dr.eval(image)
    return image
