"""`whitted gradient`."""

from functools import partial
from typing import Annotated, Literal

import typer

from .images import compute, files_of
from .options import Depth, Outputs, PrecisionName, SceneFile, Size, Spp

EXAMPLES = (
    "Examples:  whitted gradient cornell --wrt materials.glass.ior -o ior.exr -o ior.png   |   "
    "whitted gradient scenes/cornell.toml --wrt spheres.ball.center --component x "
    "--terms boundary -o edges.png"
)


def gradient(
    scene: SceneFile,
    wrt: Annotated[
        str, typer.Option(metavar="NAME", help="The parameter, such as spheres.ball.radius.")
    ],
    output: Outputs,
    component: Annotated[
        str | None,
        typer.Option(
            metavar="x|y|z",
            help="Of a vector; x, y, z of a colour are red, green, blue. 17.x is that of "
            "sphere 17 of a cloud.",
        ),
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
    """Write d image / d NAME to an EXR, a PNG, or both.

    In the PNG, blue is below 0, white is 0, and red is above 0.
    """
    from .. import gradient as differentiate
    from ..files.false_color import write_diverging
    from ..files.images import write_image

    files = files_of(output)
    derivative = partial(differentiate, name=wrt, component=component, terms=terms)
    image, metadata = compute(derivative, scene, spp, depth, size, precision)
    number = f"{wrt}.{component}" if component else wrt
    share = ""
    if files.exr:
        write_image(files.exr, image, {**metadata, "wrt": number, "terms": terms})
    if files.png:
        title = f"d image / d {number}" + ("" if terms == "both" else f", {terms} term")
        scale, clipped = write_diverging(files.png, image, title)
        typer.echo(f"scale: {scale:.3g}, of the mean of the channels")
        share = f", the PNG from blue to red with {clipped:.2%} of its pixels clipped to the scale"
    typer.echo(f"wrote {files}{share}")
