"""`whitted fit`."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from ..core.interrupts import forget, holding, insist, interruptible
from .options import Depth, Folder, PrecisionName, SceneFile, Size, Spp, size_of
from .workers import Scheduler, Workers

EXAMPLES = (
    "Examples:  whitted fit start.toml target.exr --wrt materials.glass.ior --starts 4 -o out   |"
    "   whitted fit start.toml target.exr --wrt spheres.ball.radius --wrt lights.key.position "
    "--bound spheres.ball.radius=0.1:1 -o out   |   "
    "whitted fit start.toml target.exr --wrt spheres.ball.center --starts 1000 --workers 2 -o out"
)

Target = Annotated[Path, typer.Argument(help="The picture to match, .exr (linear) or .png (sRGB).")]
Names = Annotated[
    list[str], typer.Option(metavar="NAME", help="A parameter to recover; may be repeated.")
]
Layer = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="The target's layer or part, of an EXR with several."),
]
Bounds = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=LOW:HIGH",
        help="The range of a parameter; either end may be left out; may be repeated.",
    ),
]
Priors = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=MEAN:SIGMA",
        help="What is known of a parameter before; a vector has commas, as in 0,1,0:0.2; "
        "may be repeated.",
    ),
]
Mask = Annotated[
    Path | None, typer.Option(help="A picture that is black where the target does not count.")
]
Gain = Annotated[bool, typer.Option("--gain", help="Also fit the brightness of each channel.")]
Robust = Annotated[
    Literal["huber", "cauchy"] | None,
    typer.Option(help="A loss for pictures with things that the scene lacks."),
]
Method = Annotated[
    Literal["auto", "lm", "adam"],
    typer.Option(help="Levenberg-Marquardt, Adam, or by the number of parameters."),
]
Starts = Annotated[int, typer.Option(help="Starts to try: the scene's, and random ones around it.")]
Seed = Annotated[int, typer.Option(help="Seed of all that is drawn at random.")]
Budget = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        help="For further tries, where the picture is not explained [default: 30].",
    ),
]
Once = Annotated[
    bool, typer.Option("--once", help="No further tries where the picture is not explained.")
]
# The exit status where the picture is not explained
UNEXPLAINED = 3
Iterations = Annotated[int | None, typer.Option(help="At each resolution, at most.")]
PlainDerivatives = Annotated[
    bool, typer.Option("--no-boundary", help="Derivatives of plain samples: wrong at edges.")
]


@holding
def fit(
    scene: SceneFile,
    target: Target,
    wrt: Names,
    output: Folder,
    layer: Layer = None,
    bound: Bounds = None,
    prior: Priors = None,
    mask: Mask = None,
    gain: Gain = False,
    robust: Robust = None,
    method: Method = "auto",
    starts: Starts = 1,
    seed: Seed = 0,
    budget: Budget = None,
    once: Once = False,
    iterations: Iterations = None,
    spp: Spp = 4,
    depth: Depth = None,
    size: Size = None,
    precision: PrecisionName = "single",
    no_boundary: PlainDerivatives = False,
    scheduler: Scheduler = None,
    workers: Workers = None,
) -> int:
    """Recover parameters of a scene from a picture of it.

    Writes the recovered scene, pictures and plots. The exit status is 3 if what was found does not
    explain the picture. Workers try all starts, and the best four go on. After Ctrl-C the files are
    those of the best so far, and the exit status is 130; a second Ctrl-C ends it.
    """
    from .. import fit as recover
    from .. import load_scene, read_image
    from ..files.figures import figure_of
    from ..files.progress import progress_bar
    from ..files.writable import check_folder
    from ..inverse.fit import INTERRUPTED, SECONDS
    from ..inverse.report import NAMES, write_recovery

    if once and budget is not None:
        raise ValueError("--budget: there are no further tries with --once; leave out one of both")
    check_folder(output, NAMES)
    _check_inputs([scene, target, *([mask] if mask else [])], [output / name for name in NAMES])
    start, picture = load_scene(scene, precision), read_image(target, layer)
    weights = None if mask is None else read_image(mask).numpy().mean(2)
    bounds, resolution = _bounds(bound or []), size_of(size)
    _check_target(target, picture.shape, resolution or start.resolution)
    # Find out that a library is missing before the fit, not after it
    figure_of(1)
    options: dict[str, Any] = {"spp": spp, "boundary": not no_boundary, "max_depth": depth}
    asked = {
        "wrt": wrt,
        "bounds": bounds,
        "priors": _priors(prior or []),
        "mask": weights,
        "gain": gain,
        "robust": robust,
        "method": method,
        "starts": starts,
        "seed": seed,
        "budget": None if once else SECONDS if budget is None else budget,
        "iterations": iterations,
        "resolution": resolution,
        **options,
    }
    with _warnings_printed() as warned:
        if scheduler is None and workers is None:
            result = recover(start, picture, **asked)
        else:
            result = interruptible(_on_workers, scheduler, workers, start, picture, asked)
    if len(warned) >= len(result.labels):
        raise ValueError(
            f"{target}: the picture depends on none of the parameters to recover; "
            "nothing was written"
        )
    write = partial(write_recovery, output, start, picture, result, options)
    with progress_bar("drawing"):
        files, interrupted = insist(write, result.stopped == INTERRUPTED)
    _print_fit(result)
    typer.echo(f"wrote {', '.join(path.name for path in files)} to {output}")
    if interrupted or forget():
        return 130
    return 0 if result.quality.explained else UNEXPLAINED


def _on_workers(
    scheduler: str | None, workers: int | None, start: Any, picture: Any, asked: dict[str, Any]
) -> Any:
    """A fit whose starts go to workers."""
    from ..cluster import starts
    from ..cluster.connect import connected

    with connected(scheduler, workers) as client:
        return starts.fit(start, picture, client, progress=True, **asked)


def _check_inputs(inputs: list[Path], outputs: list[Path]) -> None:
    """Refuse files that are read and would be written over."""
    for path in filter(Path.exists, inputs):
        if any(other.exists() and other.samefile(path) for other in outputs):
            raise ValueError(f"{path}: would be written over; name another folder by -o")


def _check_target(target: Path, shape: tuple[int, ...], size: tuple[int, int]) -> None:
    """Refuse a picture of another size than the images of the fit."""
    own = f"{shape[1]}x{shape[0]}"
    if own != f"{size[0]}x{size[1]}":
        raise ValueError(
            f"{target}: has {own} pixels, and the fit {size[0]}x{size[1]}; "
            f"give --size {own}, or scale the picture"
        )


def _bounds(texts: list[str]) -> dict[str, tuple[float | None, float | None]]:
    """What each --bound says, by the parameter."""
    bounds: dict[str, tuple[float | None, float | None]] = {}
    for name, ends in map(_bound, texts):
        if name in bounds:
            raise ValueError(f"--bound: given twice for {name}; give both ends in one, LOW:HIGH")
        bounds[name] = ends
    return bounds


def _bound(text: str) -> tuple[str, tuple[float | None, float | None]]:
    """The parameter, the lower and the upper end of --bound, None for an open end."""
    name, equals, ends = text.partition("=")
    low, colon, high = ends.partition(":")
    try:
        if not (equals and colon):
            raise ValueError
        return name, (float(low) if low else None, float(high) if high else None)
    except ValueError:
        raise ValueError(
            f"--bound: expected NAME=LOW:HIGH, as in materials.glass.ior=1.2:1.8, got '{text}'"
        ) from None


def _priors(texts: list[str]) -> dict[str, tuple[list[float], list[float]]]:
    """What each --prior says, by the parameter."""
    priors: dict[str, tuple[list[float], list[float]]] = {}
    for name, known in map(_prior, texts):
        if name in priors:
            raise ValueError(f"--prior: given twice for {name}; give it once")
        priors[name] = known
    return priors


def _prior(text: str) -> tuple[str, tuple[list[float], list[float]]]:
    """The parameter, the mean and the deviation of --prior, each with one number or several."""
    name, _, known = text.partition("=")
    try:
        mean, deviation = ([float(x) for x in part.split(",")] for part in known.split(":"))
    except ValueError:
        raise ValueError(
            f"--prior: expected NAME=MEAN:SIGMA, as in materials.glass.ior=1.5:0.01, got '{text}'"
        ) from None
    return name, (mean, deviation)


@contextmanager
def _warnings_printed() -> Iterator[list[warnings.WarningMessage]]:
    """Print the warnings of a block when it ends; yields the list that they are kept in."""
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        yield warned
    for warning in warned:
        typer.echo(f"warning: {warning.message}", err=True)


def _print_fit(result: Any) -> None:
    for label, value, deviation in result.numbers():
        typer.echo(f"{label:32} {value:.7g} +- {deviation:.2g}")
    for note in result.notes:
        typer.echo(f"note: {note}")
    typer.echo(result.summary())
    typer.echo(f"quality: {result.quality}")
