"""`whitted render`."""

from functools import partial
from typing import Annotated

import typer

from .images import compute, files_of
from .options import Depth, Outputs, PrecisionName, SceneFile, Size, refuse_together, size_of

EXAMPLES = (
    "Examples:  whitted render cornell -o cornell.png   |   whitted render scenes/nested.toml "
    "-o nested.exr -o nested.png --spp 16 --depth 8 --size 1024x768 --precision double"
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
) -> None:
    """Render a scene to an EXR (linear), a PNG (sRGB), or both."""
    from .. import load_scene
    from .. import render as render_image
    from ..files.images import clipped, write_image
    from ..files.progress import progress_bar
    from ..rendering.auto_samples import recommend

    files = files_of(output)
    boundary = not no_boundary
    if error is not None:
        refuse_together("--error", {"--spp": spp is not None, "--no-boundary": no_boundary})
        with progress_bar("choosing samples"):
            chosen = recommend(load_scene(scene, precision), error, depth, size_of(size))
        spp, boundary = chosen.spp, chosen.boundary
        method = "edges found" if boundary else "plain samples"
        typer.echo(f"for an error of {error:g}: spp {spp}, {method}")
    spp = 1 if spp is None else spp
    image, metadata = compute(
        partial(render_image, boundary=boundary), scene, spp, depth, size, precision
    )
    share = ""
    if files.exr:
        write_image(files.exr, image, metadata)
    if files.png:
        write_image(files.png, image)
        share = f", the PNG as sRGB with {clipped(image):.2%} of its pixels clipped to [0, 1]"
    typer.echo(f"wrote {files}{share}")
