"""The files in which the clouds of a saved scene stand."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .cloud import Cloud
from .rows import read_rows, write_rows

# A cloud of more spheres than this is saved to a file of its own
IN_LINE = 64


def filed(scene: Any, path: Path) -> tuple[Cloud, ...]:
    """A scene's clouds with the names of the files that they stand in, which are written.

    A cloud stays in the file that it was read from, if that is in the same folder and still says
    the same.

    Args:
        path: where the scene will be saved.

    Raises:
        OSError: a file cannot be written.
    """
    return tuple(_filed(scene, place, path) for place in range(len(scene.clouds)))


def _filed(scene: Any, place: int, path: Path) -> Cloud:
    cloud: Cloud = scene.clouds[place]
    parts = [scene.numbers[f"clouds.{cloud.name}.{field}"] for field in ("center", "radius")]
    numbers = np.column_stack(parts)
    if _still_says(scene, cloud.file, path, numbers):
        return cloud
    if len(numbers) <= IN_LINE:
        return replace(cloud, file="")
    own = cloud.name if re.fullmatch(r"[\w-]+", cloud.name) else f"cloud{place}"
    file = path.with_name(f"{path.stem}.{own}.npy")
    write_rows(file, numbers)
    return replace(cloud, file=file.name)


def _still_says(scene: Any, file: str, path: Path, numbers: np.ndarray) -> bool:
    """Whether a cloud's file is in the folder of the new scene, and has these numbers."""
    folder = Path(scene.folder)
    if not file or folder.resolve() != path.parent.resolve():
        return False
    try:
        before = read_rows(folder, file).numbers
    except ValueError:
        return False
    return np.array_equal(before.astype(numbers.dtype), numbers)
