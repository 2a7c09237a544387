"""`render`: one large picture, in bands of rows."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from ..files.atomic import atomically
from ..files.images import check_image
from ..files.progress import reporting
from ..files.tiles import TILE, TiledFile, check_attributes
from ..rendering.samples import check_depth, check_memory, checked_resolution, checked_side
from ..scene.scene import Scene, checked_scene
from .bands import Picture, render_band, rows_of_band
from .engine import outcomes
from .pyramid import CHUNK, new_pyramid
from .store import check_path

# Takes the first row of a band and its pixels, None if they are written already
Take = Callable[[int, Any], None]


def render(
    scene: Scene,
    client: Any = None,
    *,
    output: str | Path | None = None,
    spp: int = 1,
    boundary: bool = True,
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    metadata: dict[str, str | int | float] | None = None,
    progress: Callable[[float], None] | bool | None = None,
) -> np.ndarray | None:
    """Render a picture on all workers, in bands of rows; the pixels are those of `whitted.render`.

    Args:
        client: a `distributed.Client`; None: this process renders all.
        output: None gives the picture back. A name that ends in .exr: a tiled EXR, written as bands
            come, so that the picture need not fit in memory. One that ends in .zarr: a pyramid of
            pictures, each half as large as the one before; workers write it, and have to see it
            under this name. A file or store appears when all of it is there.
        spp, boundary, max_depth, resolution: as of `whitted.render`.
        metadata: further attributes of an EXR's header.
        progress: as of `whitted.render`.

    Returns:
        Linear RGB radiance, a NumPy array of shape (height, width, 3); None with an output.

    Raises:
        ValueError: an argument is out of range, or the picture does not fit in memory.
        OSError: the output cannot be written, as where the disk is full.
        RuntimeError: a band has failed three times, or a library is missing.
        ConnectionError: the scheduler has gone.

    Example:
        >>> cluster.render(scene, client, resolution=(32768, 32768), output="large.exr")
    """
    checked_scene(scene)
    check_attributes(metadata or {})
    side = checked_side(spp)
    check_depth(max_depth)
    size = checked_resolution(scene.resolution if resolution is None else resolution)
    path = None if output is None else Path(output).absolute()
    kind = None if path is None else path.suffix.lower()
    if path is not None and kind == ".zarr":
        check_path(path)
        if path.exists():
            raise ValueError(f"{path}: is there already; choose another name")
    elif path is not None and kind == ".exr":
        check_image(path)
    elif path is not None:
        raise ValueError(f"{path}: expected a name that ends in .exr or .zarr")
    dtype = np.dtype(scene.precision.dtype)
    options = {"boundary": boundary, "max_depth": max_depth}
    multiple = CHUNK if kind == ".zarr" else TILE
    rows = rows_of_band(size, side**2, multiple)
    check_memory(size[0], rows if path is not None else size[1], dtype.itemsize)
    about = scene, size, spp, options, rows
    with reporting(progress, "rendering") as report:
        run = _Bands(client, report or (lambda fraction: None))
        if path is None:
            whole = np.empty((size[1], size[0], 3), dtype)

            def keep(first: int, pixels: np.ndarray) -> None:
                whole[first : first + len(pixels)] = pixels

            run.all(Picture(*about), keep)
            return whole
        if kind == ".zarr":
            attributes: dict[str, str | int] = {"spp": spp, "precision": scene.precision.name}
            with new_pyramid(path, size, dtype, attributes) as store:
                run.all(Picture(*about, store=str(store)), lambda first, _: None)
            return None

        def write(temporary: Path) -> None:
            with temporary.open("wb") as file, TiledFile(file, size, metadata or {}) as tiled:
                run.all(Picture(*about), tiled.write)

        atomically(path, write)
        return None


class _Bands:
    """A run over all bands of a picture."""

    def __init__(self, client: Any, report: Callable[[float], None]) -> None:
        self.client, self.report = client, report

    def all(self, picture: Picture, take: Take) -> None:
        """Have all bands rendered, and taken in the order in which they come."""
        done = 0
        with closing(outcomes(self.client, render_band, picture, range(picture.tasks))) as run:
            for outcome in run:
                first, count = picture.band(outcome.task)
                if outcome.error is not None:
                    raise RuntimeError(
                        f"rows {first} to {first + count - 1} have failed three times: "
                        f"{outcome.error}"
                    )
                take(first, outcome.value)
                done += 1
                self.report(done / picture.tasks)
