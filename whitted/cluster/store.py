"""The Zarr store of a sweep: pictures in chunks, one for each task, and a mark for each chunk.

    data.zarr/zarr.json                 the sweep in words: all that decides about its bytes
    data.zarr/image/c/7/0/0/0           the pictures of task 7
    data.zarr/derivative/c/7/0/0/0/0    their derivatives, if asked for
    data.zarr/materials.glass.ior/c/0   the values of each number that is varied
    data.zarr/done/c/7                  the mark of task 7

Each file is written under another name and then renamed. The mark is written last, when the data is
on the disk. So whatever a crash leaves, a chunk with a mark is whole, and one without is rendered
again, to the same bytes.
"""

import os
import secrets
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .libraries import require
from .plan import Plan

IMAGE, DERIVATIVE, MARKS = "image", "derivative", "done"
# Marks: all pictures of a task are there, or all but those that the scene refused
WHOLE, PARTLY = 1, 2
# Values of a number in a chunk
VALUES = 1 << 16
# A scene of more characters than this is not kept in the attributes, but for its digest
LONGEST = 1 << 20


def check_path(path: Path) -> None:
    """Refuse a store that could not be made.

    Raises:
        ValueError: it is no folder of this machine, or its folder is missing or protected.
    """
    if "://" in str(path) or ":/" in str(path):
        raise ValueError(f"{path}: expected a folder that all workers see, not an address")
    if path.suffix.lower() != ".zarr":
        raise ValueError(f"{path}: expected a name that ends in .zarr")
    if not path.parent.is_dir():
        raise ValueError(f"{path}: there is no folder '{path.parent}'; make it first")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise ValueError(f"{path}: the folder '{path.parent}' cannot be written to; choose another")


def create(path: Path, plan: Plan) -> None:
    """Make a store without pictures; it appears when all of it is there."""
    temporary = path.with_name(f".{path.stem[:20]}-{os.getpid()}-{secrets.token_hex(4)}.zarr")
    try:
        _fill(temporary, plan)
        temporary.rename(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _fill(path: Path, plan: Plan) -> None:
    zarr = require("zarr")
    tables = plan.scene.to_dict()
    attributes: dict[str, Any] = {"sweep": plan.described()}
    if len(str(tables)) <= LONGEST:
        attributes["scene"] = tables
    group = zarr.create_group(str(path), attributes=attributes)
    width, height = plan.resolution
    number = plan.scene.precision.dtype
    rest = ("y", "x", "channel")
    arrays: dict[str, tuple[tuple[int, ...], tuple[str, ...]]] = {
        IMAGE: ((height, width, 3), ("picture", *rest))
    }
    if plan.derivatives:
        numbers = len(plan.derivatives)
        arrays[DERIVATIVE] = (numbers, height, width, 3), ("picture", "number", *rest)
    for name, (shape, axes) in arrays.items():
        group.create_array(
            name,
            shape=(plan.count, *shape),
            chunks=(plan.batch, *shape),
            dtype=number,
            fill_value=np.nan,
            dimension_names=axes,
        )
    group.create_array(
        MARKS, shape=(plan.tasks,), chunks=(1,), dtype="u1", fill_value=0, dimension_names=("task",)
    )
    for k, one in enumerate(plan.numbers):
        values = group.create_array(
            one.label,
            shape=(plan.count,),
            chunks=(min(plan.count, VALUES),),
            dtype="f8",
            fill_value=np.nan,
            dimension_names=("picture",),
        )
        for first in range(0, plan.count, VALUES):
            count = min(VALUES, plan.count - first)
            values[first : first + count] = plan.samples.values(first, count)[:, k]


def check_same(path: Path, plan: Plan) -> None:
    """Refuse to go on with the store of another sweep.

    Raises:
        ValueError: the message has what differs.
    """
    try:
        group = require("zarr").open_group(str(path), mode="r")
        there = dict(group.attrs)["sweep"]
    except (OSError, KeyError, ValueError):
        raise ValueError(f"{path}: is no sweep of whitted; choose another name") from None
    here = plan.described()
    for key, value in here.items():
        if there.get(key) != value:
            told = "" if key == "scene" else f": {there.get(key)} there, {value} here"
            raise ValueError(
                f"{path}: holds another sweep, of another {key}{told}; choose another name"
            )


def marks(path: Path) -> dict[int, int]:
    """The mark of each task that is done."""
    folder = path / MARKS / "c"
    if not folder.is_dir():
        return {}
    group = require("zarr").open_group(str(path), mode="r")
    known = [int(entry.name) for entry in os.scandir(folder) if entry.name.isdecimal()]
    if not known:
        return {}
    values = group[MARKS][:]
    return {task: int(values[task]) for task in known if values[task]}


def write(
    path: Path, plan: Plan, task: int, blocks: dict[str, np.ndarray], partly: bool = False
) -> None:
    """Write the arrays of a task, and then its mark.

    Raises:
        OSError: the disk is full, say; or the store is not there.
    """
    if not path.is_dir():
        raise FileNotFoundError(
            f"there is no folder '{path}' on this worker; all workers have to see it"
        )
    group = require("zarr").open_group(str(path), mode="r+")
    first, count = plan.pictures(task)
    for name, block in blocks.items():
        group[name][first : first + count] = block
        _to_disk(path / name / "c" / str(task), block.ndim - 1)
    group[MARKS][task] = PARTLY if partly else WHOLE


def _to_disk(folder: Path, depth: int) -> None:
    """Wait until a chunk is on the disk, so that no power failure leaves a mark without it."""
    file = folder.joinpath(*["0"] * depth)
    for path in (file, file.parent):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def record_failures(path: Path, failures: Sequence[dict[str, Any]]) -> None:
    """Note the pictures that are missing, and why; nothing is noted where none are."""
    group = require("zarr").open_group(str(path), mode="r+")
    known = dict(group.attrs)
    new = {key: value for key, value in known.items() if key != "failed"}
    if failures:
        new["failed"] = list(failures)
    if new != known:
        group.attrs.put(new)
