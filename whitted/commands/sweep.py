"""`whitted sweep`."""

import time
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from .options import Depth, PrecisionName, SceneFile, Size, Spp, size_of
from .workers import Scheduler, Workers

EXAMPLES = (
    "Examples:  whitted sweep cornell --vary materials.glass.ior=1.3:1.8 "
    "--vary spheres.ball.center.x=-0.2:0.2 --count 1000 --size 64x64 -o glass.zarr   |   "
    "whitted sweep cornell --vary materials.glass.ior=1.3:1.8 --count 1000 -o glass.zarr "
    "--workers 2 --resume"
)
# The exit status where pictures are missing
MISSING = 3
# Missing pictures that are told one by one
TOLD = 5


def sweep(
    scene: SceneFile,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="NAME=LOW:HIGH",
            help="A number and its range; may be repeated. NAME=A,B,C lists values.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="STORE", help="The Zarr store, a new folder.")
    ],
    count: Annotated[
        int | None, typer.Option(help="Pictures; may be left out where all values are listed.")
    ] = None,
    sampler: Annotated[
        Literal["grid", "sobol", "random"],
        typer.Option(help="All combinations, evenly spread, or at random."),
    ] = "sobol",
    seed: Annotated[int, typer.Option(help="Seed of what is drawn.")] = 0,
    wrt: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Also write derivatives by it; may be repeated."),
    ] = None,
    spp: Spp = 1,
    depth: Depth = None,
    size: Size = None,
    precision: PrecisionName = "single",
    no_boundary: Annotated[
        bool, typer.Option("--no-boundary", help="Plain samples: fast, wrong at edges.")
    ] = False,
    batch: Annotated[
        int | None, typer.Option(help="Pictures in a chunk [default: chosen by their size].")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a store that is not complete.")
    ] = False,
    scheduler: Scheduler = None,
    workers: Workers = None,
) -> int:
    """Render a data set: pictures of a scene with other numbers, and the numbers beside them.

    After Ctrl-C, or whatever else ends it, --resume goes on with what is there. The exit status is
    3 if some pictures could not be rendered.
    """
    from .. import load_scene
    from ..cluster import dataset
    from ..cluster.connect import connected
    from ..files.progress import progress_bar

    loaded, ranges = load_scene(scene, precision), _ranges(vary)
    start = time.perf_counter()
    asked = dataset.Asked(
        count, sampler, seed, spp, not no_boundary, depth, size_of(size), wrt or [], batch
    )
    planned = dataset.planned_sweep(loaded, ranges, output, asked)
    dataset.check_store(planned, resume)
    with connected(scheduler, workers) as client, progress_bar("rendering") as progress:
        try:
            result = dataset.carry_out(planned, client, resume=resume, progress=progress)
        except KeyboardInterrupt:
            if output.exists():
                typer.echo(f"{output}: what is done is kept; --resume goes on", err=True)
            raise
    seconds = time.perf_counter() - start
    for failure in result.failed[:TOLD]:
        typer.echo(_told(failure), err=True)
    missing = f", {len(result.failed)} of them missing" if result.failed else ""
    typer.echo(
        f"wrote {output}: {result.count} picture{'s' * (result.count > 1)}{missing}, "
        f"{result.rendered} of {result.tasks} tasks now, in {seconds:.1f} s"
    )
    return MISSING if result.failed else 0


def _told(failure: dict[str, Any]) -> str:
    """A picture that is missing, in one line."""
    values = ", ".join(f"{label} = {value:.6g}" for label, value in failure["values"].items())
    return f"picture {failure['picture']} ({values}): {failure['reason']}"


def _ranges(texts: list[str]) -> dict[str, Any]:
    """What each --vary says, by the name."""
    ranges: dict[str, Any] = {}
    for text in texts:
        name, equals, given = text.partition("=")
        if name in ranges:
            raise ValueError(f"--vary: '{name}' is given twice; give it once")
        try:
            if not equals:
                raise ValueError
            ranges[name] = _range(given)
        except ValueError:
            raise ValueError(
                "--vary: expected NAME=LOW:HIGH, as in materials.glass.ior=1.3:1.8, or "
                f"NAME=A,B,C, got '{text}'"
            ) from None
    return ranges


def _range(text: str) -> tuple[float, float] | list[float]:
    """A range, or a list of values."""
    if ":" in text:
        low, high = map(float, text.split(":"))
        return low, high
    return [float(value) for value in text.split(",")]
