"""`whitted chart`."""

from typing import Annotated

import typer

from .options import Folder, SceneFile, size_of

EXAMPLES = "Example:  whitted chart scenes/cornell.toml -o charts"


def chart(
    scene: SceneFile,
    output: Folder,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer samples, rounds and sizes.")
    ] = False,
    size: Annotated[
        str | None,
        typer.Option(
            metavar="WxH",
            help="Of the images whose errors are measured [default: 192x192, quick 96x96].",
        ),
    ] = None,
) -> None:
    """Measure a scene's speed against its accuracy, and write a report.

    An interrupted run is resumed when the command is given again.
    """
    from .. import __version__
    from ..files.progress import progress_bar
    from ..measure.chart import chart as measure

    resolution = size_of(size)
    with progress_bar("measuring") as progress:
        page = measure(scene, output, __version__, size=resolution, quick=quick, progress=progress)
    typer.echo(f"wrote {page}")
