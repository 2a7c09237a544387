"""`whitted render`."""

import time
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from .images import Files, compute, files_of
from .options import Depth, Outputs, PrecisionName, SceneFile, Size, refuse_together, size_of
from .workers import Scheduler, Workers

EXAMPLES = (
    "Examples:  whitted render cornell -o cornell.png   |   whitted render scenes/nested.toml "
    "-o nested.exr -o nested.png --spp 16 --depth 8 --size 1024x768 --precision double   |   "
    "whitted render cornell -o large.exr --size 16384x16384 --scheduler 192.168.0.7:8786"
)


def render(
    scene: SceneFile,
    output: Outputs,
    spp: Annotated[
        int | None, typer.Option(help="Samples per pixel, a perfect square [default: 1].")
    ] = None,
    depth: Depth = None,
    size: Size = None,
    precision: PrecisionName = "single",
    no_boundary: Annotated[
        bool, typer.Option("--no-boundary", help="Plain samples: fast, wrong at edges.")
    ] = False,
    error: Annotated[
        float | None,
        typer.Option(help="Choose --spp and --no-boundary for this relative error, as in 0.01."),
    ] = None,
    scheduler: Scheduler = None,
    workers: Workers = None,
) -> None:
    """Render a scene to an EXR (linear), a PNG (sRGB), or both.

    Workers render bands of rows. An EXR alone is then tiled, and written as bands come, so that it
    need not fit in memory. -o NAME.zarr writes a pyramid of pictures, each half as large.
    """
    from .. import load_scene
    from .. import render as render_image
    from ..cluster import picture
    from ..cluster.connect import connected
    from ..files.progress import progress_bar
    from ..rendering.auto_samples import recommend

    pyramid = _pyramid(output)
    files = files_of([] if pyramid else output)
    boundary = not no_boundary
    if error is not None:
        refuse_together("--error", {"--spp": spp is not None, "--no-boundary": no_boundary})
        with progress_bar("choosing samples"):
            chosen = recommend(load_scene(scene, precision), error, depth, size_of(size))
        spp, boundary = chosen.spp, chosen.boundary
        method = "edges found" if boundary else "plain samples"
        typer.echo(f"for an error of {error:g}: spp {spp}, {method}")
    spp = 1 if spp is None else spp
    if pyramid or scheduler is not None or workers is not None:
        large = pyramid or (None if files.png else files.exr)
        start = time.perf_counter()
        loaded = load_scene(scene, precision)
        with connected(scheduler, workers) as client, progress_bar("rendering") as progress:
            image = picture.render(
                loaded,
                client,
                output=large,
                spp=spp,
                boundary=boundary,
                max_depth=depth,
                resolution=size_of(size),
                progress=progress,
            )
        typer.echo(f"time: {time.perf_counter() - start:.3f} s in all")
        if image is None:
            typer.echo(f"wrote {large}")
        else:
            _write(files, image, {})
        return
    image, metadata = compute(
        partial(render_image, boundary=boundary), scene, spp, depth, size, precision
    )
    _write(files, image, metadata)


def _pyramid(output: list[Path]) -> Path | None:
    """The Zarr pyramid that -o names, if it does."""
    stores = [path for path in output if path.suffix.lower() == ".zarr"]
    if stores and len(output) > 1:
        raise ValueError(f"-o: {stores[0]} is written alone; leave out the others")
    return stores[0] if stores else None


def _write(files: Files, image: Any, metadata: dict[str, Any]) -> None:
    """Write an image to its files."""
    from ..files.images import clipped, write_image

    share = ""
    if files.exr:
        write_image(files.exr, image, metadata)
    if files.png:
        write_image(files.png, image)
        share = f", the PNG as sRGB with {clipped(image):.2%} of its pixels clipped to [0, 1]"
    typer.echo(f"wrote {files}{share}")
