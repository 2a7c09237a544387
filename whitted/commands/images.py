"""What the commands share that write an image: its files, its numbers and its time."""

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typer

from .options import size_of


@dataclass(frozen=True)
class Files:
    """The files that an image is written to; None for one that was not named."""

    exr: Path | None
    png: Path | None

    def __str__(self) -> str:
        return " and ".join(str(path) for path in (self.exr, self.png) if path)


def files_of(outputs: Sequence[Path]) -> Files:
    """The files that -o names, before time goes into what they hold.

    Raises:
        ValueError: a file could not be written, or there are two of a kind.
    """
    from ..files.images import check_image

    for path in outputs:
        check_image(path)
    kinds = {
        suffix: [path for path in outputs if path.suffix.lower() == suffix]
        for suffix in (".exr", ".png")
    }
    for suffix, paths in kinds.items():
        if len(paths) > 1:
            names = " and ".join(map(str, paths))
            raise ValueError(f"-o: {names} end in {suffix}; name at most one .exr and one .png")
    return Files(*(paths[0] if paths else None for paths in kinds.values()))


def compute(
    function: Callable[..., Any],
    scene: Path,
    spp: int,
    depth: int | None,
    size: str | None,
    precision: str,
) -> tuple[Any, dict[str, str | int | float]]:
    """Load a scene, compute an image of it, and print how long that took.

    Args:
        function: takes the scene and options of `render`, and returns the image.

    Returns:
        The image, and how it was made, for the header of an EXR.
    """
    from .. import __version__, load_scene
    from ..files.progress import progress_bar
    from ..measure import timing
    from ..measure.about import compiled_in

    loaded = load_scene(scene, precision)
    resolution = size_of(size)
    start = time.perf_counter()
    with timing.recorded() as kernels, progress_bar("rendering") as progress:
        image = function(loaded, spp=spp, max_depth=depth, resolution=resolution, progress=progress)
    seconds = time.perf_counter() - start
    height, width, _ = image.shape
    depth = depth or loaded.max_depth
    typer.echo(f"{scene}: {width} x {height}, spp {spp}, depth {depth}, {precision} precision")
    typer.echo(f"compiled in: {compiled_in(loaded)}; {kernels.operations} operations")
    typer.echo(
        f"time: {kernels.compile_seconds:.3f} s compile, {kernels.run_seconds:.3f} s run, "
        f"{seconds:.3f} s in all"
    )
    return image, {
        "whitted": __version__,
        "sceneSHA256": hashlib.sha256(loaded.text.encode()).hexdigest(),
        "spp": spp,
        "maxDepth": depth,
        "precision": precision,
        "renderSeconds": seconds,
    }
