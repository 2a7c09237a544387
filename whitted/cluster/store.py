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

import errno
import os
import secrets
import shutil
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .libraries import require
from .plan import Plan
from .work import told

IMAGE, DERIVATIVE, MARKS = "image", "derivative", "done"
# Marks: all pictures of a task are there, or all but those that the scene refused
WHOLE, PARTLY = 1, 2
# Values of a number in a chunk
VALUES = 1 << 16
# Pictures that are missing, of which the attributes tell
RECORDED = 1000
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
    if not path.exists() and not os.access(path.parent, os.W_OK | os.X_OK):
        raise ValueError(f"{path}: the folder '{path.parent}' cannot be written to; choose another")


def create(path: Path, plan: Plan) -> None:
    """Make a store without pictures; it appears when all of it is there."""
    temporary = path.with_name(f".{path.stem[:20]}-{os.getpid()}-{secrets.token_hex(4)}.zarr")
    try:
        _fill(temporary, plan)
        temporary.rename(path)
    finally:
        remove(temporary)


def remove(folder: Path) -> None:
    """Remove a folder, into which workers may still be writing for a moment."""
    for _ in range(50):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return
        time.sleep(0.1)


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
    differ = [
        key if key == "scene" else f"{key} ({there.get(key)} there, {value} here)"
        for key, value in plan.described().items()
        if there.get(key) != value
    ]
    if differ:
        raise ValueError(
            f"{path}: holds another sweep, of another {', '.join(differ)}; choose another name"
        )


def marks(path: Path) -> dict[int, int]:
    """The mark of each task that is done."""
    folder = path / MARKS / "c"
    if not folder.is_dir():
        return {}
    known = [int(entry.name) for entry in os.scandir(folder) if entry.name.isdecimal()]
    if not known:
        return {}
    try:
        values = require("zarr").open_group(str(path), mode="r")[MARKS][:]
    except Exception as error:
        # Whatever Zarr says of a file that it cannot read
        raise ValueError(
            f"{path}: is damaged, its marks cannot be read ({told(error)}); render it anew under "
            "another name"
        ) from error
    # A chunk that someone has deleted is rendered again
    chunks = path / IMAGE / "c"
    return {
        task: int(values[task]) for task in known if values[task] and (chunks / str(task)).is_dir()
    }


def check_seen(path: Path) -> None:
    """Refuse to write into a store that is not there, as on a worker without the shared folder."""
    if not path.is_dir():
        missing = "is no folder on this worker; all workers have to see it"
        raise FileNotFoundError(errno.ENOENT, missing, str(path))


def write(
    path: Path, plan: Plan, task: int, blocks: dict[str, np.ndarray], partly: bool = False
) -> None:
    """Write the arrays of a task, and then its mark.

    Raises:
        OSError: the disk is full, say; or the store is not there.
    """
    check_seen(path)
    zarr = require("zarr")
    group = zarr.open_group(str(path), mode="r+")
    first, count = plan.pictures(task)
    for name, block in blocks.items():
        # Also where the scene has refused all pictures
        with zarr.config.set({"array.write_empty_chunks": True}):
            group[name][first : first + count] = block
        file = path.joinpath(name, "c", str(task), *["0"] * (block.ndim - 1))
        _to_disk(file)
        remove_partial(file.parent)
    group[MARKS][task] = PARTLY if partly else WHOLE


def _to_disk(file: Path) -> None:
    """Wait until a chunk is on the disk, so that no power failure leaves a mark without it."""
    for path in (file, file.parent):
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def remove_partial(folder: Path) -> None:
    """Remove what Zarr had not yet renamed where a process was killed."""
    for entry in os.scandir(folder):
        if entry.name.endswith(".partial"):
            Path(entry).unlink(missing_ok=True)


def finish(path: Path, failures: Sequence[dict[str, Any]]) -> None:
    """Note the pictures that are missing; remove what killed processes have left."""
    _record_failures(path, failures)
    for folder in (path, path / MARKS / "c"):
        remove_partial(folder)


def _record_failures(path: Path, failures: Sequence[dict[str, Any]]) -> None:
    """Note the pictures that are missing, and why; nothing is noted where none are."""
    group = require("zarr").open_group(str(path), mode="r+")
    known = dict(group.attrs)
    left_out = len(failures) - RECORDED
    failures = list(failures[:RECORDED])
    if left_out > 0:
        failures.append({"more": left_out})
    new = {key: value for key, value in known.items() if key != "failed"}
    if failures:
        new["failed"] = list(failures)
    if new != known:
        group.attrs.put(new)
