"""`whitted stress`."""

from typing import Annotated

import typer

from .options import Folder

EXAMPLES = "Examples:  whitted stress -o stress   |   whitted stress 3 critical-angle -o stress"


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
    from ..files.writable import check_folder
    from ..stress import report, suite

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
