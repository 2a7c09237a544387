"""`whitted info`."""

import typer

EXAMPLES = "Example:  whitted info"


def info() -> None:
    """Print the versions of Dr.Jit and LLVM, the number of threads, and what is missing."""
    from .. import __version__
    from ..measure import about

    for name, value in {"whitted": __version__, **about.system()}.items():
        typer.echo(f"{name + ':':14}{value}")
