"""The cheapest samples that make an image accurate enough, found by trying them.

A small image tells what each setting costs. In that order they are tried against a better one, on
an image of the size that is asked for, or of a smaller one if that is large, until one is good
enough. Errors lie along edges, which cross a smaller part of a larger image's pixels: with n times
as many pixels sqrt(n) times as many have edges, whose share of the mean square falls like 1 /
sqrt(n), and the error like n^(-1/4).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import drjit as dr
import numpy as np

from ..core.arrays import Array
from ..scene.scene import Scene
from .samples import render_samples

# Samples along a pixel's side of what is tried, plain and with edges
SIDES = {False: (1, 2, 3, 4, 6, 8, 12, 16), True: (1, 2)}
# Plain samples a pixel that errors are told from where those with edges would take longer
MANY = 1024
# What is left of the error with edges where spp is 4 and not 1, at most
FALL_WITH_EDGES = 1 / 4
# Pixels along the longer side of the image whose times are taken, and most of the one whose errors
# are
SMALL, LARGE = 128, 512
# What the samples of an image with edges cost more than plain ones
LABELS = 1.2
# What is chosen is to be better by this factor: the reference has an error of its own
SAFETY = 1.03
# The power of the number of pixels with which the error falls, less than the 1/4 above
FALL = 0.2


@dataclass(frozen=True)
class Setting:
    """One way to render an image."""

    spp: int
    boundary: bool
    cost: float  # expected, in seconds


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
    """All settings, with the times expected at a resolution."""
    size, more = _reduced(resolution, SMALL)
    result = []
    plain: dict[int, float] = {}
    for boundary, sides in SIDES.items():
        for side in sides:
            options = {"boundary": boundary, "max_depth": max_depth, "resolution": size}
            seconds = _seconds(partial(render_samples, scene, side**2, **options))
            plain.setdefault(side, seconds)
            edges = max(0.0, seconds - LABELS * plain[side]) if boundary else 0.0
            cost = more * plain[side] * (LABELS if boundary else 1) + more**0.5 * edges
            result.append(Setting(side * side, boundary, cost))
    return result


def _errors(
    scene: Scene, max_depth: int | None, resolution: tuple[int, int], offered: list[Setting]
) -> Callable[[Setting], float]:
    """A function that measures a setting's relative error, against a good one of those offered or
    many plain samples.
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
    """A resolution of at most so many pixels a side, and how many times as many pixels the given
    one has.
    """
    factor = min(1.0, side / max(resolution))
    size = max(1, round(resolution[0] * factor)), max(1, round(resolution[1] * factor))
    return size, resolution[0] * resolution[1] / (size[0] * size[1])


def _seconds(call: Callable[[], Array]) -> float:
    """The time of an image once its kernels are compiled: the least of two, as other programs may
    disturb one.
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
