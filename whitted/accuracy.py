"""The cheapest samples that make an image accurate enough, found by measuring a small image.

Errors lie along edges, which cross a smaller part of a larger image's pixels: n times as many pixels have edges in
sqrt(n) times as many, whose share of the mean square falls like 1 / sqrt(n), and the error like n^(-1/4).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import drjit as dr
import numpy as np

from .geometry import Array
from .render import render as render_samples
from .scene import Scene

# Samples along a pixel's side of what is tried, plain and with edges
SIDES = {False: (1, 2, 3, 4, 6, 8, 12, 16), True: (1, 2, 3, 4)}
# Pixels along the longer side of the small image, and plain samples a pixel of its reference
SMALL, REFERENCE = 128, 1024
# What the samples of an image with edges cost more than plain ones
LABELS = 1.2
# The true error may be larger than the expected one: what is chosen is to be better by this factor
SAFETY = 1.15


@dataclass(frozen=True)
class Setting:
    """One way to render an image."""

    spp: int
    boundary: bool
    error: float  # expected, relative RMSE
    cost: float  # expected, in seconds


def render(scene: Scene, spp: int = 1, *, error: float | None = None, **options: Any) -> Array:
    """Render a scene, differentiably in the parameters that `Scene.replace` gave it.

    Args:
        spp: samples a pixel, a perfect square n * n.
        error: choose spp and boundary so that the relative error (RMSE over the image's root mean square) is at most
            this, and the cost is least; takes the place of both.
        options: `boundary`, `terms`, `max_depth`, `resolution` and `progress` of `whitted.render.render`: edges are found
            unless boundary=False.

    Returns:
        Linear RGB radiance, a `TensorXf` (`TensorXf64` in double precision) of shape (height, width, 3).

    Raises:
        ValueError: an argument is out of range, or the image does not fit in memory.
    """
    if error is None:
        return render_samples(scene, spp, **options)
    for name, given in (("spp", spp != 1), ("boundary", "boundary" in options)):
        if given:
            raise ValueError(f"error: chooses {name} itself; leave {name} out, or error")
    chosen = recommend(scene, error, options.get("max_depth"), options.get("resolution"))
    return render_samples(scene, chosen.spp, **{**options, "boundary": chosen.boundary})


def recommend(scene: Scene, error: float, max_depth: int | None = None, resolution: tuple[int, int] | None = None) -> Setting:
    """The cheapest setting whose error is at most this.

    Raises:
        ValueError: an error that is not above 0, or below what the settings tried reach.
    """
    if not (isinstance(error, (int, float)) and 0 < error < np.inf):
        raise ValueError(f"error: expected a relative error above 0, as in 0.01, got {error!r}")
    settings = measured(scene, max_depth, resolution or scene.resolution)
    good = [setting for setting in settings if setting.error * SAFETY <= error]
    if not good:
        best = min(settings, key=lambda setting: setting.error)
        raise ValueError(f"error: {error:g} is below what is tried; about {SAFETY * best.error:.2g} is the least for this scene")
    return min(good, key=lambda setting: setting.cost)


def measured(scene: Scene, max_depth: int | None, resolution: tuple[int, int]) -> list[Setting]:
    """All settings, with the errors and times expected at a resolution."""
    factor = min(1.0, SMALL / max(resolution))
    size = max(1, round(resolution[0] * factor)), max(1, round(resolution[1] * factor))
    more = resolution[0] * resolution[1] / (size[0] * size[1])

    def image(spp: int, boundary: bool) -> Array:
        return render_samples(scene, spp, boundary=boundary, max_depth=max_depth, resolution=size)

    settings = []
    with dr.suspend_grad():
        reference = image(REFERENCE, False).numpy().astype(np.float64)
        scale = float(np.sqrt(np.mean(reference**2))) or 1.0
        plain: dict[int, float] = {}
        for boundary, sides in SIDES.items():
            for side in sides:
                pixels, seconds = _timed(partial(image, side * side, boundary))
                error = float(np.sqrt(np.mean((pixels.numpy() - reference) ** 2))) / scale
                plain.setdefault(side, seconds)
                edges = max(0.0, seconds - LABELS * plain[side]) if boundary else 0.0
                cost = more * plain[side] * (LABELS if boundary else 1) + more**0.5 * edges
                settings.append(Setting(side * side, boundary, error * more**-0.25, cost))
    return settings


def _timed(call: Callable[[], Array]) -> tuple[Array, float]:
    """An image, and the seconds that it takes once its kernels are compiled."""
    dr.eval(call())
    dr.sync_thread()
    start = time.perf_counter()
    pixels = call()
    dr.eval(pixels)
    dr.sync_thread()
    return pixels, time.perf_counter() - start
