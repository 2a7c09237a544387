"""The command line: parses, calls, prints errors; no logic of its own."""

import hashlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.exceptions import TyperException

app = typer.Typer(
    help="A differentiable Whitted ray tracer.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
)


class Precision(str, Enum):
    single = "single"
    double = "double"


class Component(str, Enum):
    x = "x"
    y = "y"
    z = "z"


class Terms(str, Enum):
    both = "both"
    interior = "interior"
    boundary = "boundary"


class Method(str, Enum):
    auto = "auto"
    lm = "lm"
    adam = "adam"


SceneFile = Annotated[Path, typer.Argument(help="The scene, a TOML file.")]
Spp = Annotated[int, typer.Option(help="Samples a pixel, a perfect square.")]
Depth = Annotated[
    int | None, typer.Option(help="Nodes on the longest chain of rays [default: the scene's].")
]
Size = Annotated[
    str | None,
    typer.Option(metavar="WxH", help="Width and height in pixels [default: the scene's]."),
]
AnyPrecision = Annotated[Precision, typer.Option(help="Of every computation.")]


@app.command(
    epilog="Examples:  whitted render scenes/cornell.toml -o cornell.exr   |   "
    "whitted render scenes/nested.toml -o nested.exr --spp 16 --depth 8 --size 1024x768 --precision double"
)
def render(
    scene: SceneFile,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", help="Image to write, .exr; a .png preview goes next to it."
        ),
    ],
    spp: Spp = 1,
    depth: Depth = None,
    size: Size = None,
    precision: AnyPrecision = Precision.single,
    no_boundary: Annotated[
        bool, typer.Option("--no-boundary", help="Plain samples: fast, wrong at edges.")
    ] = False,
    error: Annotated[
        float | None,
        typer.Option(help="Choose samples and edges for this relative error, as in 0.01."),
    ] = None,
) -> None:
    """Render a scene to an EXR, with a PNG preview next to it."""
    from . import load_scene
    from . import render as render_image
    from .files.images import clipped, write_image
    from .rendering.auto_samples import recommend

    _check_output(output)
    boundary = not no_boundary
    if error is not None:
        chosen = recommend(
            load_scene(scene, precision.value), error, depth, _size(size) if size else None
        )
        spp, boundary = chosen.spp, chosen.boundary
        typer.echo(
            f"for an error of {error:g}: spp {spp}, {'edges found' if boundary else 'plain samples'}"
        )
    image, metadata = _compute(
        partial(render_image, boundary=boundary), scene, spp, depth, size, precision
    )
    preview = output.with_suffix(".png")
    write_image(output, image, metadata)
    write_image(preview, image)
    typer.echo(
        f"wrote {output}, and {preview} as sRGB with {clipped(image):.2%} of its pixels clipped to [0, 1]"
    )


@app.command(
    epilog="Examples:  whitted gradient scenes/cornell.toml --wrt materials.glass.ior -o ior.exr   |   "
    "whitted gradient scenes/cornell.toml --wrt spheres.ball.center --component x --terms boundary -o edges.exr"
)
def gradient(
    scene: SceneFile,
    wrt: Annotated[
        str, typer.Option(metavar="NAME", help="The parameter, such as spheres.ball.radius.")
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", help="Derivative to write, .exr; a .png in colours goes next to it."
        ),
    ],
    component: Annotated[
        Component | None,
        typer.Option(help="Of a vector; x, y, z of a colour are red, green, blue."),
    ] = None,
    terms: Annotated[
        Terms, typer.Option(help="What is between edges, what moving edges add, or both.")
    ] = Terms.both,
    spp: Spp = 1,
    depth: Depth = None,
    size: Size = None,
    precision: AnyPrecision = Precision.single,
) -> None:
    """Write d image / d NAME as an EXR, with a PNG next to it: blue below 0, white at 0, red above."""
    from . import gradient as differentiate
    from .files.false_color import write_diverging
    from .files.images import write_image

    _check_output(output)
    derivative = partial(
        differentiate, name=wrt, component=component and component.value, terms=terms.value
    )
    image, metadata = _compute(derivative, scene, spp, depth, size, precision)
    number = f"{wrt}.{component.value}" if component else wrt
    preview = output.with_suffix(".png")
    write_image(output, image, {**metadata, "wrt": number, "terms": terms.value})
    title = f"d image / d {number}" + ("" if terms is Terms.both else f", {terms.value} term")
    scale, clipped = write_diverging(preview, image, title)
    typer.echo(f"scale: {scale:.3g}, of the mean of the channels")
    typer.echo(
        f"wrote {output}, and {preview} from blue to red with {clipped:.2%} of its pixels clipped to the scale"
    )


@app.command(
    epilog="Examples:  whitted fit start.toml target.exr --wrt materials.glass.ior --starts 4 -o out   |   "
    "whitted fit start.toml target.exr --wrt spheres.ball.radius --wrt lights.key.position --bound spheres.ball.radius=0.1:1 -o o"
)
def fit(
    scene: SceneFile,
    target: Annotated[
        Path, typer.Argument(help="The picture to match, .exr (linear) or .png (sRGB).")
    ],
    wrt: Annotated[
        list[str], typer.Option(metavar="NAME", help="A parameter to recover; may be repeated.")
    ],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="Folder for the recovered scene, pictures and plots."),
    ],
    bound: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=LOW:HIGH", help="Its range; either may be left out."),
    ] = None,
    mask: Annotated[
        Path | None, typer.Option(help="A picture that is black where the target does not count.")
    ] = None,
    gain: Annotated[
        bool, typer.Option("--gain", help="Fit the brightness of each channel along.")
    ] = False,
    method: Annotated[
        Method, typer.Option(help="Levenberg-Marquardt, Adam, or by the number of parameters.")
    ] = Method.auto,
    starts: Annotated[
        int, typer.Option(help="Places to start from, drawn around the scene's.")
    ] = 1,
    seed: Annotated[int, typer.Option(help="Of that draw.")] = 0,
    iterations: Annotated[int | None, typer.Option(help="At each resolution, at most.")] = None,
    spp: Spp = 4,
    depth: Depth = None,
    size: Size = None,
    precision: AnyPrecision = Precision.single,
    no_boundary: Annotated[
        bool, typer.Option("--no-boundary", help="Derivatives of samples alone: wrong at edges.")
    ] = False,
) -> None:
    """Recover parameters of a scene from a picture of it, and write the recovered scene and
    pictures to a folder.
    """
    import warnings

    from . import fit as recover
    from . import load_scene, read_image
    from .files.figures import figure_of
    from .inverse.report import write_recovery
    from .scene.rewrite import rewritten

    start = load_scene(scene, precision.value)
    picture, weights = (
        read_image(target),
        None if mask is None else read_image(mask).numpy().mean(2),
    )
    resolution = _size(size) if size else None
    _check_folder(output)
    # What is missing is better known before than after
    rewritten(scene, {})
    figure_of(1)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        result = recover(
            start,
            picture,
            wrt=wrt,
            bounds=dict(map(_bound, bound or [])),
            mask=weights,
            gain=gain,
            method=method.value,
            starts=starts,
            seed=seed,
            iterations=iterations,
            spp=spp,
            boundary=not no_boundary,
            max_depth=depth,
            resolution=resolution,
        )
    for warning in warned:
        typer.echo(f"warning: {warning.message}", err=True)
    if len(warned) >= len(result.labels):
        raise ValueError(
            f"{target}: the picture depends on none of the parameters to recover; nothing was written"
        )
    options = {"spp": spp, "boundary": not no_boundary, "max_depth": depth}
    files = write_recovery(output, scene, start, picture, result, options)
    for label, value, deviation in result.numbers():
        typer.echo(f"{label:32} {value:.7g} +- {deviation:.2g}")
    for note in result.notes:
        typer.echo(f"note: {note}")
    typer.echo(f"{result.stopped}, after {len(result.history)} iterations; loss {result.loss:.4g}")
    typer.echo(f"wrote {', '.join(path.name for path in files)} to {output}")


@app.command(epilog="Example:  whitted chart scenes/cornell.toml -o charts")
def chart(
    scene: SceneFile,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for the report, plots and numbers.")
    ],
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer samples, rounds and sizes.")
    ] = False,
    size: Size = None,
) -> None:
    """Measure a scene's speed against its accuracy, and write a report; an interrupted run goes on
    where it was.
    """
    from . import __version__
    from .measure.chart import chart as measure

    _check_folder(output)
    with _progress_bar("measuring") as progress:
        resolution = _size(size) if size else None
        page = measure(
            scene,
            output,
            __version__,
            size=resolution,
            quick=quick,
            progress=lambda done, _: progress(done),
        )
    typer.echo(f"wrote {page}")


def _bound(text: str) -> tuple[str, tuple[float | None, float | None]]:
    name, equals, pair = text.partition("=")
    low, colon, high = pair.partition(":")
    try:
        if not (equals and colon):
            raise ValueError
        return name, (float(low) if low else None, float(high) if high else None)
    except ValueError:
        raise ValueError(
            f"--bound: expected NAME=LOW:HIGH, as in materials.glass.ior=1.2:1.8, got '{text}'"
        ) from None


def _check_folder(output: Path) -> None:
    """Refuse a folder that could not be made or written to."""
    if output.exists() and not output.is_dir():
        raise ValueError(f"{output}: is a file; name a folder")
    if not output.parent.is_dir():
        raise ValueError(f"{output}: there is no folder '{output.parent}'; make it first")
    if not os.access(output if output.exists() else output.parent, os.W_OK):
        raise ValueError(f"{output}: cannot be written to; choose another folder")


def _compute(
    function: Callable,
    scene: Path,
    spp: int,
    depth: int | None,
    size: str | None,
    precision: Precision,
) -> tuple[Any, dict[str, str | int | float]]:
    """Load a scene, make an image of it, print what that took; returns the image and how it was
    made.
    """
    from . import __version__, load_scene
    from .measure import timing
    from .measure.about import features

    loaded = load_scene(scene, precision.value)
    start = time.perf_counter()
    with timing.recorded() as kernels, _progress_bar() as progress:
        resolution = _size(size) if size else None
        image = function(loaded, spp=spp, max_depth=depth, resolution=resolution, progress=progress)
    seconds = time.perf_counter() - start
    height, width, _ = image.shape
    depth = depth or loaded.max_depth
    typer.echo(
        f"{scene}: {width} x {height}, spp {spp}, depth {depth}, {precision.value} precision"
    )
    typer.echo(f"compiled in: {', '.join(features(loaded))}; {kernels.operations} operations")
    typer.echo(
        f"time: {kernels.compile_seconds:.3f} s compile, {kernels.run_seconds:.3f} s run, {seconds:.3f} s in all"
    )
    return image, {
        "whitted": __version__,
        "sceneSHA256": hashlib.sha256(scene.read_bytes()).hexdigest(),
        "spp": spp,
        "maxDepth": depth,
        "precision": precision.value,
        "renderSeconds": seconds,
    }


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise ValueError(f"--size: expected WIDTHxHEIGHT, as in 640x480, got '{text}'")
    return int(width), int(height)


def _check_output(output: Path) -> None:
    """Refuse what could not be written before time goes into it."""
    if output.suffix.lower() != ".exr":
        raise ValueError(f"{output}: expected a file name that ends in .exr")
    if not output.parent.is_dir():
        raise ValueError(f"{output}: there is no folder '{output.parent}'; make it first")
    if not os.access(output.parent, os.W_OK):
        raise ValueError(
            f"{output}: the folder '{output.parent}' cannot be written to; choose another"
        )
    for path in (output, output.with_suffix(".png")):
        if path.is_dir():
            raise ValueError(f"{path}: is a folder; name a file")


@contextmanager
def _progress_bar(title: str = "rendering") -> Iterator[Callable[[float], None]]:
    """A callback for the fraction done, which shows a bar on standard error, where that is a
    terminal, after a second.
    """
    from rich.console import Console
    from rich.progress import Progress

    start = time.monotonic()
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=True) as bar:
        task = bar.add_task(title, total=1.0)

        def report(fraction: float) -> None:
            if (
                bar.disable
                and console.is_terminal
                and time.monotonic() - start > 1
                and fraction < 1
            ):
                bar.disable = False
                bar.start()
            bar.update(task, completed=fraction)

        yield report


@app.command(
    epilog="Examples:  whitted stress -o stress   |   whitted stress 3 critical-angle -o stress",
)
def stress(
    output: Annotated[
        Path,
        typer.Option("-o", "--output", help="Folder for report.html, results.csv and the charts."),
    ],
    cases: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CASE]...", help="Numbers or names [default: all]."),
    ] = None,
) -> int:
    """Run the cases that are hard for ray tracers, in both precisions; the exit status is 1 where
    one fails.
    """
    from .files.figures import figure_of
    from .stress import report as stress_report
    from .stress import suite

    chosen = suite.choose(cases or [])
    _check_folder(output)
    figure_of(1)
    output.mkdir(exist_ok=True)
    typer.echo(suite.HEADER)
    results = suite.run(chosen, lambda result: typer.echo(suite.line(result)))
    *charts, _, page = stress_report.write(output, results)
    failed = sum(not result.passed for result in results)
    typer.echo(f"{len(results)} results, {failed} failed; wrote {page} with {len(charts)} charts")
    return 1 if failed else 0


@app.command(epilog="Example:  whitted info")
def info() -> None:
    """Tell which Dr.Jit, LLVM and threads are used, and what is missing."""
    from . import __version__
    from .measure import about

    for name, value in {"whitted": __version__, **about.system()}.items():
        typer.echo(f"{name + ':':14}{value}")


def run(arguments: list[str]) -> int:
    """Run a command; returns the exit status."""
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


# Signals received: Dr.Jit may turn the exception of Ctrl-C into one of its own
_interrupts: list[int] = []


def _interrupt(number: int, _: object) -> None:
    _interrupts.append(number)
    raise KeyboardInterrupt


def main() -> None:
    if signal.getsignal(signal.SIGINT) in (signal.SIG_DFL, signal.default_int_handler):
        signal.signal(signal.SIGINT, _interrupt)
    sys.exit(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
