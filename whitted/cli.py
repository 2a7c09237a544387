"""The command line: parses arguments, calls the library, and prints results and errors."""

import hashlib
import io
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer.exceptions import TyperException

from .core.interrupts import forget, holding, insist

app = typer.Typer(
    help="A differentiable Whitted ray tracer.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
)

# Options of several commands
SceneFile = Annotated[
    Path, typer.Argument(help="The scene, a TOML file; or the name of a shipped one, as cornell.")
]
Spp = Annotated[int, typer.Option(help="Samples per pixel, a perfect square.")]
Depth = Annotated[
    int | None,
    typer.Option(help="Rays on the longest chain, the camera ray included [default: the scene's]."),
]
Size = Annotated[
    str | None,
    typer.Option(metavar="WxH", help="Width and height in pixels [default: the scene's]."),
]
PrecisionName = Annotated[
    Literal["single", "double"], typer.Option(help="Floating-point precision, float32 or float64.")
]
Folder = Annotated[
    Path, typer.Option("-o", "--output", help="Folder for the results; made if it is not there.")
]


@app.command(
    epilog="Examples:  whitted render scenes/cornell.toml -o cornell.exr   |   "
    "whitted render scenes/nested.toml -o nested.exr --spp 16 --depth 8 --size 1024x768 "
    "--precision double"
)
def render(
    scene: SceneFile,
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="Image to write, .exr; a .png goes next to it."),
    ],
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
    """Render a scene to an EXR, with a PNG next to it."""
    from . import load_scene
    from . import render as render_image
    from .files.images import clipped, write_image
    from .rendering.auto_samples import recommend

    _check_output(output)
    boundary = not no_boundary
    if error is not None:
        _refuse_together("--error", {"--spp": spp is not None, "--no-boundary": no_boundary})
        chosen = recommend(load_scene(scene, precision), error, depth, _size(size))
        spp, boundary = chosen.spp, chosen.boundary
        method = "edges found" if boundary else "plain samples"
        typer.echo(f"for an error of {error:g}: spp {spp}, {method}")
    spp = 1 if spp is None else spp
    image, metadata = _compute(
        partial(render_image, boundary=boundary), scene, spp, depth, size, precision
    )
    preview = output.with_suffix(".png")
    write_image(output, image, metadata)
    write_image(preview, image)
    share = f"{clipped(image):.2%} of its pixels clipped to [0, 1]"
    typer.echo(f"wrote {output}, and {preview} as sRGB with {share}")


@app.command(
    epilog="Examples:  whitted gradient scenes/cornell.toml --wrt materials.glass.ior -o ior.exr"
    "   |   whitted gradient scenes/cornell.toml --wrt spheres.ball.center --component x "
    "--terms boundary -o edges.exr"
)
def gradient(
    scene: SceneFile,
    wrt: Annotated[
        str, typer.Option(metavar="NAME", help="The parameter, such as spheres.ball.radius.")
    ],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="Derivative to write, .exr; a .png goes next to it."),
    ],
    component: Annotated[
        Literal["x", "y", "z"] | None,
        typer.Option(help="Of a vector; x, y, z of a colour are red, green, blue."),
    ] = None,
    terms: Annotated[
        Literal["both", "interior", "boundary"],
        typer.Option(help="The derivative between edges, that of moving edges, or both."),
    ] = "both",
    spp: Spp = 1,
    depth: Depth = None,
    size: Size = None,
    precision: PrecisionName = "single",
) -> None:
    """Write d image / d NAME as an EXR, with a PNG in colours next to it.

    In the PNG, blue is below 0, white is 0, and red is above 0.
    """
    from . import gradient as differentiate
    from .files.false_color import write_diverging
    from .files.images import write_image

    _check_output(output)
    derivative = partial(differentiate, name=wrt, component=component, terms=terms)
    image, metadata = _compute(derivative, scene, spp, depth, size, precision)
    number = f"{wrt}.{component}" if component else wrt
    preview = output.with_suffix(".png")
    write_image(output, image, {**metadata, "wrt": number, "terms": terms})
    title = f"d image / d {number}" + ("" if terms == "both" else f", {terms} term")
    scale, clipped = write_diverging(preview, image, title)
    typer.echo(f"scale: {scale:.3g}, of the mean of the channels")
    share = f"{clipped:.2%} of its pixels clipped to the scale"
    typer.echo(f"wrote {output}, and {preview} from blue to red with {share}")


# Options of `fit`
Target = Annotated[Path, typer.Argument(help="The picture to match, .exr (linear) or .png (sRGB).")]
Names = Annotated[
    list[str], typer.Option(metavar="NAME", help="A parameter to recover; may be repeated.")
]
Bounds = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=LOW:HIGH", help="Its range; either end may be left out."),
]
Mask = Annotated[
    Path | None, typer.Option(help="A picture that is black where the target does not count.")
]
Gain = Annotated[bool, typer.Option("--gain", help="Also fit the brightness of each channel.")]
Method = Annotated[
    Literal["auto", "lm", "adam"],
    typer.Option(help="Levenberg-Marquardt, Adam, or by the number of parameters."),
]
Starts = Annotated[int, typer.Option(help="Starts to try: the scene's, and random ones around it.")]
Seed = Annotated[int, typer.Option(help="Seed of the random starts.")]
Iterations = Annotated[int | None, typer.Option(help="At each resolution, at most.")]
PlainDerivatives = Annotated[
    bool, typer.Option("--no-boundary", help="Derivatives of plain samples: wrong at edges.")
]


@app.command(
    epilog="Examples:  whitted fit start.toml target.exr --wrt materials.glass.ior --starts 4 "
    "-o out   |   whitted fit start.toml target.exr --wrt spheres.ball.radius "
    "--wrt lights.key.position --bound spheres.ball.radius=0.1:1 -o out"
)
@holding
def fit(
    scene: SceneFile,
    target: Target,
    wrt: Names,
    output: Folder,
    bound: Bounds = None,
    mask: Mask = None,
    gain: Gain = False,
    method: Method = "auto",
    starts: Starts = 1,
    seed: Seed = 0,
    iterations: Iterations = None,
    spp: Spp = 4,
    depth: Depth = None,
    size: Size = None,
    precision: PrecisionName = "single",
    no_boundary: PlainDerivatives = False,
) -> int:
    """Recover parameters of a scene from a picture of it.

    Writes the recovered scene, pictures and plots. After Ctrl-C it writes those of the best so far,
    and the exit status is 130; a second Ctrl-C ends it.
    """
    from . import fit as recover
    from . import load_scene, read_image
    from .files.figures import figure_of
    from .files.writable import check_folder
    from .inverse.fit import INTERRUPTED
    from .inverse.report import NAMES, write_recovery

    start, picture = load_scene(scene, precision), read_image(target)
    weights = None if mask is None else read_image(mask).numpy().mean(2)
    bounds, resolution = _bounds(bound or []), _size(size)
    check_folder(output, NAMES)
    # Find out that a library is missing before the fit, not after it
    figure_of(1)
    options: dict[str, Any] = {"spp": spp, "boundary": not no_boundary, "max_depth": depth}
    with _warnings_printed() as warned:
        result = recover(
            start,
            picture,
            wrt=wrt,
            bounds=bounds,
            mask=weights,
            gain=gain,
            method=method,
            starts=starts,
            seed=seed,
            iterations=iterations,
            resolution=resolution,
            **options,
        )
    if len(warned) >= len(result.labels):
        raise ValueError(
            f"{target}: the picture depends on none of the parameters to recover; "
            "nothing was written"
        )
    write = partial(write_recovery, output, start, picture, result, options)
    files, interrupted = insist(write, result.stopped == INTERRUPTED)
    _print_fit(result)
    typer.echo(f"wrote {', '.join(path.name for path in files)} to {output}")
    return 130 if interrupted or forget() else 0


@app.command(epilog="Example:  whitted chart scenes/cornell.toml -o charts")
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
    from . import __version__
    from .files.progress import progress_bar
    from .measure.chart import chart as measure

    resolution = _size(size)
    with progress_bar("measuring") as progress:
        page = measure(scene, output, __version__, size=resolution, quick=quick, progress=progress)
    typer.echo(f"wrote {page}")


@app.command(
    epilog="Examples:  whitted stress -o stress   |   whitted stress 3 critical-angle -o stress",
)
def stress(
    output: Folder,
    cases: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CASE]...", help="Numbers or names [default: all]."),
    ] = None,
) -> int:
    """Run cases that are hard for ray tracers, in both precisions, and write a report.

    The exit status is 1 if one fails.
    """
    from .files.writable import check_folder
    from .stress import report, suite

    chosen = suite.choose(cases or [])
    check_folder(output, report.names(chosen))
    report.require_libraries()
    output.mkdir(exist_ok=True)
    typer.echo(suite.HEADER)
    results = suite.run(chosen, lambda result: typer.echo(suite.line(result)))
    *charts, _, page = report.write(output, results)
    failed = sum(not result.passed for result in results)
    typer.echo(f"{len(results)} results, {failed} failed; wrote {page} with {len(charts)} charts")
    return 1 if failed else 0


@app.command(epilog="Example:  whitted info")
def info() -> None:
    """Print the versions of Dr.Jit and LLVM, the number of threads, and what is missing."""
    from . import __version__
    from .measure import about

    for name, value in {"whitted": __version__, **about.system()}.items():
        typer.echo(f"{name + ':':14}{value}")


def _size(text: str | None) -> tuple[int, int] | None:
    """The width and height of --size, None where it is not given."""
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ValueError(f"--size: expected WIDTHxHEIGHT, as in 640x480, got '{text}'")
    return int(width), int(height)


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


def _check_output(output: Path) -> None:
    """Refuse an EXR that could not be written, or a PNG next to it, before time goes into it."""
    from .files.images import check_image

    if output.suffix.lower() != ".exr":
        raise ValueError(f"{output}: expected a file name that ends in .exr")
    for path in (output, output.with_suffix(".png")):
        check_image(path)


def _refuse_together(option: str, others: dict[str, bool]) -> None:
    """Refuse options that are given and that another one chooses itself."""
    given = [name for name, is_given in others.items() if is_given]
    if given:
        names = " and ".join(given)
        raise ValueError(f"{option}: chooses {names} itself; leave {names} out, or {option}")


def _compute(
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
    from . import __version__, load_scene
    from .files.progress import progress_bar
    from .measure import timing
    from .measure.about import compiled_in

    loaded = load_scene(scene, precision)
    resolution = _size(size)
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
    typer.echo(f"{result.stopped}, after {len(result.history)} iterations; loss {result.loss:.4g}")


def run(arguments: list[str]) -> int:
    """Run a command.

    Returns:
        The exit status: that of the command, 2 for an error, which is printed on standard error in
        one line, and 130 after Ctrl-C.
    """
    try:
        return app(arguments, prog_name="whitted", standalone_mode=False) or 0
    except TyperException as error:
        message = error.format_message()
    except KeyboardInterrupt:
        return 130
    except MemoryError:
        message = "not enough memory; use a smaller resolution"
    except OSError as error:
        message = (
            f"{error.filename}: cannot be read or written: {error.strerror}"
            if error.filename
            else str(error)
        )
    except (ValueError, RuntimeError) as error:
        message = str(error)
    except KeyError as error:
        message = error.args[0]
    if _interrupts:
        return 130
    print(message, file=sys.stderr)
    return 2


# Signals received. Dr.Jit may turn the KeyboardInterrupt of a callback into an error of its own, so
# that the exception alone does not tell that Ctrl-C was pressed.
_interrupts: list[int] = []


def _interrupt(number: int, _: object) -> None:
    _interrupts.append(number)
    raise KeyboardInterrupt


def main() -> None:
    """Run the command of this process's arguments, and exit with its status."""
    # The name of a file that is to be printed may not be text
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    # A shell that runs the process in the background has it ignore Ctrl-C; leave that as it is
    if signal.getsignal(signal.SIGINT) in (signal.SIG_DFL, signal.default_int_handler):
        signal.signal(signal.SIGINT, _interrupt)
    sys.exit(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
