"""Options of commands whose work may go to a cluster."""

from typing import Annotated

import typer

Scheduler = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="A Dask scheduler whose workers do the work."),
]
Workers = Annotated[
    int | None,
    typer.Option(
        metavar="N", help="Workers to start on this machine, for the time of the command."
    ),
]
