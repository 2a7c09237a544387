"""`whitted params`."""

from typing import Annotated

import typer

from .options import SceneFile

EXAMPLES = "Examples:  whitted params cornell   |   whitted params cornell 'spheres.*.center'"


def params(
    scene: SceneFile,
    pattern: Annotated[
        str | None,
        typer.Argument(help="Names to list; * stands for any part of one [default: all]."),
    ] = None,
) -> None:
    """List a scene's parameters and their values."""
    import drjit as dr

    from .. import load_scene

    names = () if pattern is None else (pattern,)
    # In double precision, so that numbers are printed as they stand in the file
    values = load_scene(scene, "double").parameters(*names)
    width = max(map(len, values))
    for name, value in values.items():
        if name.startswith("clouds."):
            typer.echo(f"{name:{width}}  of {dr.width(value)} spheres")
            continue
        numbers = "  ".join(f"{number:.10g}" for number in value.numpy().ravel())
        typer.echo(f"{name:{width}}  {numbers}")
