"""`sweep`: a data set of pictures of a scene whose numbers are varied."""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..files.progress import reporting
from ..rendering.samples import check_depth, check_memory, checked_resolution, checked_side
from ..scene.scene import Scene, checked_scene
from . import store
from .engine import outcomes
from .libraries import require
from .numbers import Number, numbers_named
from .pictures import Sweep, render_pictures
from .plan import Plan, batch_of, is_whole, samples_of
from .work import stops


@dataclass(frozen=True)
class SweepResult:
    """What a sweep has written."""

    path: Path  #: of the store
    count: int  #: pictures
    tasks: int  #: into which they were cut, one chunk each
    rendered: int  #: tasks that this call did; a sweep that goes on has others
    #: each picture that is missing: its number, its values, the reason
    failed: list[dict[str, Any]]


def sweep(
    scene: Scene,
    vary: Mapping[str, Any],
    path: str | Path,
    client: Any = None,
    *,
    count: int | None = None,
    sampler: str = "sobol",
    seed: int = 0,
    spp: int = 1,
    boundary: bool = True,
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    derivatives: Sequence[str] = (),
    batch: int | None = None,
    resume: bool = False,
    progress: Callable[[float], None] | bool | None = None,
) -> SweepResult:
    """Render a data set: pictures of a scene with other numbers, and the numbers beside them.

    Pictures are rendered in tasks, one chunk of the store each. A run that was killed goes on with
    `resume=True`, and ends with the same bytes as one that was not.

    Args:
        scene: all that is not varied is that of this scene.
        vary: name to (low, high), to a list of values, or to a function that draws them: it takes a
            NumPy generator and the count. Names are those of `Scene.parameters`; of a vector also
            its components, as in "spheres.ball.center.x".
        path: a folder that ends in .zarr, which all workers see under this name.
        client: a `distributed.Client`; None: this process renders all.
        count: the number of pictures. It may be left out where all values are listed.
        sampler: "sobol" spreads pictures evenly over the ranges, "random" draws them, "grid" takes
            all combinations. Listed values are one for each picture, or one axis of a grid.
        seed: of what is drawn, from 0 on.
        spp, boundary, max_depth, resolution: as of `render`.
        derivatives: names of numbers by which the pictures are differentiated.
        batch: pictures of a task [default: enough for about half a second].
        resume: go on with the store if it is there, and has the same parameters.
        progress: as of `render`.

    Returns:
        What was written. Pictures that could not be rendered are listed, and NaN in the store: a
        task that fails is tried three times, and the rest goes on.

    Raises:
        KeyError: a name that the scene does not have.
        ValueError: another argument is out of range, or the store is there already.
        OSError: the store cannot be written, as where the disk is full.
        ConnectionError: the scheduler has gone.
        RuntimeError: a library is missing.

    Example:
        >>> ior = "materials.glass.ior"
        >>> cluster.sweep(scene, {ior: (1.3, 1.8)}, "glass.zarr", count=1000)
    """
    about = Asked(count, sampler, seed, spp, boundary, max_depth, resolution, derivatives, batch)
    planned = planned_sweep(scene, vary, path, about)
    return carry_out(planned, client, resume=resume, progress=progress)


@dataclass(frozen=True)
class Asked:
    """What a user asks of a sweep; see there."""

    count: int | None
    sampler: str
    seed: int
    spp: int
    boundary: bool
    max_depth: int | None
    resolution: tuple[int, int] | None
    derivatives: Sequence[str]
    batch: int | None


def planned_sweep(scene: Scene, vary: Mapping[str, Any], path: str | Path, asked: Asked) -> Sweep:
    """Check what is asked of a sweep, before workers are started; its errors."""
    checked_scene(scene)
    require("zarr")
    if not isinstance(path, (str, Path)):
        raise ValueError(f"path: expected the name of a folder that ends in .zarr, got {path!r}")
    path = Path(path).absolute()
    store.check_path(path)
    numbers, samples = samples_of(scene, vary, asked.sampler, asked.count, asked.seed)
    wrt = _derivatives(scene, asked.derivatives)
    if not isinstance(asked.boundary, (bool, np.bool_)):
        raise ValueError(f"boundary: expected True or False, got {asked.boundary!r}")
    size = checked_resolution(scene.resolution if asked.resolution is None else asked.resolution)
    check_memory(*size, np.dtype(scene.precision.dtype).itemsize)
    check_depth(asked.max_depth)
    per_picture = size[0] * size[1] * checked_side(asked.spp) ** 2
    batch = asked.batch
    if batch is None:
        batch = batch_of(samples.count, per_picture, len(wrt))
    elif not is_whole(batch) or batch < 1:
        raise ValueError(f"batch: expected a whole number from 1 on, got {batch!r}")
    batch = min(int(batch), samples.count)
    _check_batch(batch, size, len(wrt), np.dtype(scene.precision.dtype).itemsize)
    depth = int(asked.max_depth or scene.max_depth)
    about = size, int(asked.spp), bool(asked.boundary), depth, batch
    return Sweep(path, Plan(scene, numbers, samples, tuple(wrt), *about))


def _derivatives(scene: Scene, asked: Any) -> list[Number]:
    """The numbers by which pictures are differentiated."""
    names = [asked] if isinstance(asked, str) else asked
    if not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"derivatives: expected names of parameters, got {asked!r}")
    wrt = [one for name in names for one in numbers_named(scene, name)]
    labels = [one.label for one in wrt]
    for label in labels:
        if labels.count(label) > 1:
            raise ValueError(f"derivatives: '{label}' is named twice")
    return wrt


def _check_batch(batch: int, size: tuple[int, int], derivatives: int, itemsize: int) -> None:
    """Refuse tasks whose pictures do not fit in memory."""
    need = batch * size[0] * size[1] * 3 * itemsize * (1 + derivatives)
    if need > os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2:
        raise ValueError(
            f"batch: {batch} pictures take {need / (1 << 30):.1f} GiB, too much; take a smaller one"
        )


def carry_out(
    sweep: Sweep,
    client: Any,
    *,
    resume: bool = False,
    progress: Callable[[float], None] | bool | None = None,
) -> SweepResult:
    """Render what a sweep lacks; its arguments, its result and its errors."""
    path, plan = sweep.path, sweep.plan
    check_store(sweep, resume)
    try:
        done = _opened(path, plan)
        with reporting(progress, "rendering") as report:
            failed, rendered = _run(client, sweep, done, report or (lambda fraction: None))
    except ConnectionError as error:
        remedy = "what is done is kept; start another one, and resume"
        raise ConnectionError(f"{error}; {remedy}") from None
    except OSError as error:
        if not stops(error):
            raise
        kept = "; what is done is kept, and resume goes on" if path.exists() else ""
        raise OSError(error.errno, f"{error.strerror}{kept}", str(path)) from error
    store.finish(path, failed)
    return SweepResult(path, plan.count, plan.tasks, rendered, failed)


def check_store(sweep: Sweep, resume: bool) -> None:
    """Refuse a store that is there already, or is one of another sweep."""
    path = sweep.path
    if os.path.lexists(path) and not resume:
        raise ValueError(f"{path}: is there already; resume it, or choose another name")
    if os.path.lexists(path):
        store.check_same(path, sweep.plan)


def _opened(path: Path, plan: Plan) -> set[int]:
    """Make the store, or open it. Returns the tasks that are done."""
    if not path.exists():
        store.create(path, plan)
        return set()
    return {task for task, mark in store.marks(path).items() if mark == store.WHOLE}


def _run(
    client: Any, sweep: Sweep, done: set[int], report: Callable[[float], None]
) -> tuple[list[dict[str, Any]], int]:
    """Do the tasks that are left. Returns the pictures that failed, and the number of tasks."""
    plan, rendered = sweep.plan, 0
    failures: list[tuple[int, str]] = []
    left = (task for task in range(plan.tasks) if task not in done)
    if done:
        report(len(done) / plan.tasks)
    with closing(outcomes(client, render_pictures, sweep, left)) as run:
        for outcome in run:
            rendered += 1
            if outcome.error is None:
                failures += outcome.value
            else:
                first, count = plan.pictures(outcome.task)
                failures += [(first + k, outcome.error) for k in range(count)]
            report((len(done) + rendered) / plan.tasks)
    return [_failure(plan, *one) for one in sorted(failures)], rendered


def _failure(plan: Plan, picture: int, reason: str) -> dict[str, Any]:
    """A picture that is missing, as it is recorded."""
    values = plan.samples.values(picture, 1)[0].tolist()
    labels = (number.label for number in plan.numbers)
    return {
        "picture": picture,
        "values": dict(zip(labels, values, strict=True)),
        "reason": reason,
    }
