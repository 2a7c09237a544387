"""The cheapest setting that makes an image accurate enough, found by trying.

A small image tells what each setting costs. Settings are then tried from the cheapest on, until one
is good enough. Each is compared with a better one, on an image of the size that is asked for, or on
a smaller image if that is large.

Errors of a smaller image tell those of a larger one, because they lie along edges. With n times as
many pixels, sqrt(n) times as many have edges. Their share of the mean square falls like 1 /
sqrt(n), and the relative error like n^(-1/4).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array
from ..scene.scene import Scene
from .samples import render_samples

# Samples along a pixel's side of what is tried, plain and with edges
SIDES = {False: (1, 2, 3, 4, 6, 8, 12, 16), True: (1, 2)}
# The reference has edges and 4 samples a pixel. Where that would take longer, it has this many
# plain samples
MANY = 1024
# The error with edges falls at least by this factor from 1 sample a pixel to 4
FALL_WITH_EDGES = 1 / 4
# Pixels along the longer side, at most, of the image that is timed, and of the one whose error is
# measured
SMALL, LARGE = 128, 512
# How many times as long a sample with a label takes as a plain one
LABELS = 1.2
# The error of the chosen setting is to be better by this factor, as the reference has an error of
# its own
SAFETY = 1.03
# The error is taken to fall like the number of pixels to this power; 1/4 in theory, as said above
FALL = 0.2


@dataclass(frozen=True)
class Setting:
    """One way to render an image."""

    spp: int
    boundary: bool
    cost: float  # expected seconds


def recommend(
    scene: Scene,
    error: float,
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
) -> Setting:
    """The cheapest setting whose error is at most this.

    Raises:
        ValueError: an error that is not above 0, or below what the settings tried reach.
    """
    if not (isinstance(error, (int, float)) and 0 < error < np.inf):
        raise ValueError(f"error: expected a relative error above 0, as in 0.01, got {error!r}")
    best = np.inf
    resolution = resolution or scene.resolution
    with dr.suspend_grad():
        offered = sorted(settings(scene, max_depth, resolution), key=lambda setting: setting.cost)
        error_of = _errors(scene, max_depth, resolution, offered)
        for setting in offered:
            found = SAFETY * error_of(setting)
            if found <= error:
                return setting
            best = min(best, found)
    raise ValueError(
        f"error: {error:g} is below what is tried; about {best:.2g} is the least for this scene"
    )


def settings(scene: Scene, max_depth: int | None, resolution: tuple[int, int]) -> list[Setting]:
    """All settings, with the expected times at a resolution."""
    size, more = _reduced(resolution, SMALL)
    result = []
    plain: dict[int, float] = {}
    for boundary, sides in SIDES.items():
        for side in sides:
            options: dict[str, Any] = {"max_depth": max_depth, "resolution": size}
            seconds = _seconds(
                partial(render_samples, scene, side**2, boundary=boundary, **options)
            )
            plain.setdefault(side, seconds)
            edges = max(0.0, seconds - LABELS * plain[side]) if boundary else 0.0
            cost = more * plain[side] * (LABELS if boundary else 1) + more**0.5 * edges
            result.append(Setting(side * side, boundary, cost))
    return result


def _errors(
    scene: Scene, max_depth: int | None, resolution: tuple[int, int], offered: list[Setting]
) -> Callable[[Setting], float]:
    """A function that measures a setting's relative error.

    The reference is a good one of those offered, or has many plain samples.
    """
    size, more = _reduced(resolution, LARGE)

    @lru_cache
    def image(spp: int, boundary: bool) -> np.ndarray:
        pixels = render_samples(scene, spp, boundary=boundary, max_depth=max_depth, resolution=size)
        return pixels.numpy().astype(np.float64)

    cost = {(one.spp, one.boundary): one.cost for one in offered}
    best = (4, True) if cost[4, True] < MANY * cost[1, False] else (MANY, False)
    reference = image(*best)
    scale = float(np.sqrt(np.mean(reference**2))) or 1.0

    def error_of(chosen: Setting) -> float:
        itself = (chosen.spp, chosen.boundary) == best
        pixels = image(1, True) if itself else image(chosen.spp, chosen.boundary)
        error = float(np.sqrt(np.mean((pixels - reference) ** 2))) / scale * more**-FALL
        return error * FALL_WITH_EDGES if itself else error

    return error_of


def _reduced(resolution: tuple[int, int], side: int) -> tuple[tuple[int, int], float]:
    """A resolution of at most `side` pixels a side, and the ratio of the pixels that it leaves out.

    The ratio is that of the given number of pixels to the reduced one.
    """
    factor = min(1.0, side / max(resolution))
    size = max(1, round(resolution[0] * factor)), max(1, round(resolution[1] * factor))
    return size, resolution[0] * resolution[1] / (size[0] * size[1])


def _seconds(call: Callable[[], Array]) -> float:
    """The time of an image once its kernels are compiled.

    It is the least of two, since other programs may disturb one.
    """
    dr.eval(call())
    times = []
    for _ in range(2):
        dr.sync_thread()
        start = time.perf_counter()
        dr.eval(call())
        dr.sync_thread()
        times.append(time.perf_counter() - start)
    return min(times)
