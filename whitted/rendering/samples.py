"""Rendering with a given number of samples.

The image comes from a plain kernel. Its derivatives come from kernels that trace again, with
gradients. So nothing of the trees of rays is stored in between.
"""

import math
import os
from collections.abc import Callable, Sequence
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array, Parameters
from ..core.derivatives import LOCK, operation
from ..core.frozen import is_recording
from ..core.interrupts import heed, held
from ..edges.correction import TERMS, WEIGHTS
from ..scene.features import branches_out
from ..scene.scene import MAX_DEPTH, Scene
from .job import BoundaryJob, Job

MAX_SPP = 1 << 16
# Derivatives that one kernel computes: each more compiles longer, and gains less
DIRECTIONS = 4
# Levels of trees in straight code: 63 nodes of a tree, which compile for some seconds
MAX_LEVELS, MAX_LEVELS_OF_CHAINS = 6, 64


def render_samples(scene: Scene, spp: int = 1, **options: Any) -> Array:
    """`render` with a given number of samples: its arguments, its result and its errors."""
    job, wrt = _job_of(scene, spp, **options)
    with LOCK:
        image = job.image()
        if not wrt:
            return image
        # Only the arrays in `wrt` are inputs. A method hides all others from Dr.Jit, and keeps none
        made = [(job, image)]
        return held(dr.custom, _Render, wrt, made.pop)


class Linearised:
    """An image of parameters with gradients, and its derivatives in any directions of them.

    Args:
        scene: what `Scene.replace` has made with `values`.
        values: parameters by name, with gradients.
        options: of `render_samples`.
    """

    def __init__(self, scene: Scene, values: Parameters, **options: Any) -> None:
        self.values = values
        self._job, self._wrt = _job_of(scene, **options)
        with LOCK:
            self.image: Array = self._job.image()

    def along(self, directions: Sequence[Parameters]) -> list[Array]:
        """The derivatives of the image along tangents of the parameters, for each direction.

        Up to DIRECTIONS share one call of a kernel; copies of the last direction fill the last call
        up.
        """
        tangents = [self._inner(direction) for direction in directions]
        parts = -(-len(tangents) // DIRECTIONS)
        size = -(-len(tangents) // parts)
        tangents += tangents[-1:] * (parts * size - len(tangents))
        wrt, columns = dr.detach(self._wrt), []
        for first in range(0, len(tangents), size):
            with LOCK:
                columns += self._job.tangents(wrt, tangents[first : first + size])
        return columns[: len(directions)]

    def _inner(self, direction: Parameters) -> Parameters:
        """The tangents of what kernels take."""
        for name, tangent in direction.items():
            dr.set_grad(self.values[name], tangent)
        dr.forward_to(*self._wrt.values(), flags=dr.ADFlag.ClearInterior)
        tangents = dr.grad(self._wrt)
        dr.clear_grad(self._wrt)
        return tangents


def _job_of(
    scene: Scene,
    spp: int = 1,
    *,
    boundary: bool = True,
    terms: str = "both",
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    rows: tuple[int, int] | None = None,
    unroll: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[Job, Parameters]:
    """The image to compute, and those of its inputs that have gradients; errors of `render`."""
    heed()
    if terms not in TERMS or (terms != "both" and not boundary):
        raise ValueError(
            f"terms: expected one of {', '.join(TERMS)}, with boundary=True, got {terms!r}"
        )
    if boundary and is_recording():
        raise ValueError(
            "boundary: edges are found outside of kernels, and cannot be recorded; "
            "render with boundary=False in functions that dr.freeze records"
        )
    side = checked_side(spp)
    check_depth(max_depth)
    check_levels(scene, unroll)
    size = checked_resolution(scene.resolution if resolution is None else resolution)
    part = None if rows is None else checked_rows(rows, size[1])
    check_memory(size[0], part[1] if part else size[1], dr.itemsize_v(scene.background))
    wrt = scene.differentiated()
    depth = int(max_depth or scene.max_depth)
    about = scene, scene.given, size, depth, side, progress, part, unroll
    if boundary:
        return BoundaryJob(*about, bool(wrt), terms=terms), wrt
    # Derivatives by a weight of 0 take rays that the image does not trace
    keep = bool(wrt) and not any(name.endswith(WEIGHTS) for name in wrt)
    return Job(*about, keep), wrt


def check_levels(scene: Scene, unroll: object) -> None:
    """Refuse more levels of straight code than compile in some seconds."""
    branching = branches_out(scene)
    most = MAX_LEVELS if branching else MAX_LEVELS_OF_CHAINS
    if unroll is not None and not _is_whole(unroll, 0, most):
        rays = "branch" if branching else "form chains"
        raise ValueError(
            f"unroll: expected a whole number from 0 to {most}, since the scene's rays {rays}, "
            f"got {unroll!r}"
        )


def _is_whole(value: object, low: int, high: int) -> bool:
    return (
        isinstance(value, (int, np.integer))
        and not isinstance(value, bool)
        and bool(low <= value <= high)
    )


def checked_side(spp: object) -> int:
    """The samples along a pixel's side, of the samples a pixel that a user gives."""
    side = (
        math.isqrt(spp) if isinstance(spp, (int, np.integer)) and _is_whole(spp, 1, MAX_SPP) else 0
    )
    if side * side != spp or not side:
        raise ValueError(
            f"spp: expected a perfect square (1, 4, 9, 16, ...) up to {MAX_SPP}, got {spp!r}"
        )
    return side


def check_depth(max_depth: object) -> None:
    """Refuse a depth that a user gives; None is the scene's."""
    if max_depth is not None and not _is_whole(max_depth, 1, MAX_DEPTH):
        raise ValueError(
            f"max_depth: expected a whole number from 1 to {MAX_DEPTH}, got {max_depth!r}"
        )


def checked_resolution(resolution: object) -> tuple[int, int]:
    """The width and the height that a user gives."""
    pair = tuple(resolution) if isinstance(resolution, (tuple, list)) else ()
    if len(pair) != 2 or not all(_is_whole(n, 1, 1 << 20) for n in pair):
        expected = "(width, height), two whole numbers of pixels > 0"
        raise ValueError(f"resolution: expected {expected}, got {resolution!r}")
    return int(pair[0]), int(pair[1])


def checked_rows(rows: object, height: int) -> tuple[int, int]:
    """The first of the rows that a user asks for, and their number."""
    pair = tuple(rows) if isinstance(rows, (tuple, list)) else ()
    whole = len(pair) == 2 and _is_whole(pair[0], 0, height - 1)
    if not (whole and _is_whole(pair[1], 1, height - pair[0])):
        expected = f"(first, count), two whole numbers within the rows 0 to {height - 1}"
        raise ValueError(f"rows: expected {expected}, got {rows!r}")
    return int(pair[0]), int(pair[1])


def check_memory(width: int, height: int, size: int) -> None:
    """Refuse an image that does not fit in memory; a number takes `size` bytes."""
    need, have = width * height * 3 * size, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if need > have / 2 or width * height * 3 >= 1 << 32:
        takes = f"an image of {width} x {height} takes {need / (1 << 30):.1f} GiB"
        raise ValueError(f"resolution: {takes}, too much; use a smaller one")


class _Render(dr.CustomOp):
    """The image as one node of Dr.Jit's computation graph."""

    def eval(self, wrt, made):
        self.wrt = wrt
        self.job, image = made()
        return image

    @operation
    def forward(self):
        self.set_grad_out(self.job.tangents(self.wrt, [self.grad_in("wrt")])[0])

    @operation
    def backward(self):
        self.set_grad_in("wrt", self.job.adjoint(self.wrt, self.grad_out()))
