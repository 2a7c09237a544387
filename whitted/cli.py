"""The command line: its commands, and how errors are printed."""

import io
import signal
import sys
from typing import Annotated

import typer
from typer.exceptions import TyperException

from .commands import chart, fit, gradient, info, params, render, stress, sweep, view
from .commands.once import OnceCommand

app = typer.Typer(
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=True,
)


# The options that functions know by other names
OPTIONS = {
    "bounds": "--bound",
    "max_depth": "--depth",
    "name": "--wrt",
    "priors": "--prior",
    "resolution": "--size",
    "derivatives": "--wrt",
    **{name: f"--{name}" for name in ("component", "error", "iterations", "mask", "seed", "spp")},
    **{name: f"--{name}" for name in ("budget", "robust", "starts", "terms", "wrt")},
    **{name: f"--{name}" for name in ("batch", "count", "sampler", "scheduler", "vary", "workers")},
}


def _print_version(wanted: bool) -> None:
    if wanted:
        from . import __version__

        typer.echo(f"whitted {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """A differentiable Whitted ray tracer."""


for module, command in (
    (render, render.render),
    (gradient, gradient.gradient),
    (params, params.params),
    (fit, fit.fit),
    (sweep, sweep.sweep),
    (view, view.view),
    (chart, chart.chart),
    (stress, stress.stress),
    (info, info.info),
):
    app.command(cls=OnceCommand, epilog=module.EXAMPLES)(command)


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
        context = getattr(error, "ctx", None)
        # A message of several lines is the help itself
        if context is not None and "\n" not in message:
            message = f"{message.removesuffix('.')}; see: {context.command_path} --help"
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
    print(_with_options(message), file=sys.stderr)
    return 2


def _with_options(message: str) -> str:
    """A message that begins with an argument of a function, with the option in its place."""
    name, colon, rest = message.partition(":")
    return f"{OPTIONS.get(name, name)}{colon}{rest}"


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
