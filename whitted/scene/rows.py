"""The numbers of a cloud, as the tables of a scene hold them, and files of them."""

import io
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..core.parameter import LARGEST
from ..files.atomic import write_bytes

EXPECTED = "rows of four numbers: a center and a radius > 0"
# Bytes of memory that a sphere takes while its tree is built, about
BYTES = 400


class Rows:
    """The spheres of a cloud. Two are equal if their numbers and files are."""

    def __init__(self, numbers: np.ndarray, file: str = "") -> None:
        """Keep an array.

        Args:
            numbers: (N, 4), centers and radii.
            file: what they were read from, as the scene file names it; empty without one.
        """
        self.numbers, self.file = numbers, file

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Rows):
            return NotImplemented
        return self.file == other.file and np.array_equal(self.numbers, other.numbers)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"{len(self.numbers)} spheres"

    def written(self) -> Any:
        """What a scene file says: the name of a file, or the rows themselves."""
        if self.file:
            return self.file
        return [[float(str(x)) for x in row] for row in self.numbers]


def rows_of(value: Any) -> Rows:
    """The rows that a file or an argument gives.

    Raises:
        ValueError: they are not rows of four numbers, each a sphere.
    """
    if isinstance(value, Rows):
        return value
    try:
        numbers = np.asarray(value) if len(value) else np.empty((0, 4))
    except (TypeError, ValueError):
        raise ValueError(f"expected {EXPECTED}") from None
    if numbers.dtype.kind not in "fiu" or _has_truth_values(value):
        raise ValueError(f"expected {EXPECTED}")
    return checked_rows(numbers)


def checked_rows(numbers: np.ndarray, file: str = "") -> Rows:
    """The rows of an array.

    Raises:
        ValueError: the first row that is none, or an array of another shape.
    """
    if numbers.dtype.kind not in "fiu":
        raise ValueError(f"expected {EXPECTED}, got an array of {numbers.dtype}")
    if numbers.ndim != 2 or numbers.shape[1] != 4:
        shape = " x ".join(map(str, numbers.shape))
        raise ValueError(f"expected N {EXPECTED}, got an array of shape {shape}")
    check_room(len(numbers))
    real = numbers.astype(float)
    fits = (np.abs(real) <= LARGEST).all(1) & (real[:, 3] >= 1 / LARGEST)
    if not fits.all():
        first = int(np.flatnonzero(~fits)[0])
        told = ", ".join(f"{x:g}" for x in real[first])
        expected = f"finite numbers of at most {LARGEST:g}, and a radius > 0"
        raise ValueError(f"row {first} is [{told}]: expected {expected}")
    return Rows(real, file)


def check_room(count: int) -> None:
    """Refuse more spheres than fit in memory.

    Raises:
        ValueError: the message has an estimate.
    """
    have = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if count * BYTES > have / 2 or count >= 1 << 30:
        need = f"{count} spheres take about {count * BYTES / (1 << 30):.1f} GiB"
        raise ValueError(f"{need}, too much for a memory of {have / (1 << 30):.1f} GiB; use fewer")


def _has_truth_values(value: Any) -> bool:
    """Whether True or False is among the numbers of a list. NumPy would take it for a number."""
    if isinstance(value, np.ndarray):
        return False
    return any(isinstance(x, bool) for row in value for x in (row if isinstance(row, list) else ()))


def with_files(tables: Any, folder: Path) -> tuple[Any, list[str]]:
    """The tables of a scene with the rows of files in place of their names, and what is wrong.

    Args:
        folder: what the names are relative to.
    """
    clouds = tables.get("clouds") if isinstance(tables, Mapping) else None
    if not isinstance(clouds, list):
        return tables, []
    found, filled = [], []
    for k, cloud in enumerate(clouds):
        name = cloud.get("spheres") if isinstance(cloud, Mapping) else None
        if isinstance(name, str):
            try:
                cloud = {**cloud, "spheres": read_rows(folder, name)}
            except ValueError as error:
                found.append(f'clouds[{k}].spheres = "{name}": {error}')
                cloud = {**cloud, "spheres": Rows(np.empty((0, 4)), name)}
        filled.append(cloud)
    return {**tables, "clouds": filled}, found


def read_rows(folder: Path, name: str) -> Rows:
    """The rows of a file.

    Raises:
        ValueError: it cannot be read, or has something else.
    """
    path = folder / name
    if path.suffix not in (".npy", ".csv"):
        raise ValueError("expected a file that ends in .npy or .csv, or rows of four numbers")
    try:
        size = path.stat().st_size
        check_room(size // (32 if path.suffix == ".npy" else 64))
        if path.suffix == ".npy":
            numbers = np.load(path, allow_pickle=False)
        else:
            numbers = _read_csv(path)
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror or error}") from None
    except (EOFError, ValueError) as error:
        told = str(error).splitlines()[0] if str(error) else "it is empty"
        raise ValueError(f"not a file of {EXPECTED}: {told}") from None
    return checked_rows(numbers, name)


def _read_csv(path: Path) -> np.ndarray:
    """The numbers of a file of comma-separated values; a first line of words is a header."""
    text = path.read_text()
    first, _, rest = text.partition("\n")
    if first.strip() and not _is_number(first.split(",")[0]):
        text = rest
    if not text.strip():
        return np.empty((0, 4))
    return np.loadtxt(io.StringIO(text), delimiter=",", ndmin=2)


def _is_number(word: str) -> bool:
    try:
        return not math.isinf(float(word)) or True
    except ValueError:
        return False


def write_rows(path: Path, numbers: np.ndarray) -> None:
    """Write a .npy file.

    Raises:
        OSError: it cannot be written.
    """
    buffer = io.BytesIO()
    np.save(buffer, numbers)
    write_bytes(path, buffer.getvalue())
