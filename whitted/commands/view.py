"""`whitted view`."""

from pathlib import Path
from typing import Annotated

import typer

from .options import SceneFile

EXAMPLES = "Examples:  whitted view cornell   |   whitted view start.toml --target photo.png"


def view(
    scene: SceneFile,
    target: Annotated[
        Path | None,
        typer.Option(metavar="PICTURE", help="A picture to compare with and to fit, .exr or .png."),
    ] = None,
    port: Annotated[
        int | None, typer.Option(help="Where the page is served [default: 8750, or a free one].")
    ] = None,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Only print the address of the page.")
    ] = False,
    share: Annotated[
        bool, typer.Option("--share", help="Let several pages show the scene at once.")
    ] = False,
) -> None:
    """Move, differentiate and recover a scene on a page of this machine.

    The page is served until Ctrl-C, on this machine alone. What it saves is written to the folder
    of the scene's file; of a shipped scene, to the current folder.
    """
    from .. import load_scene, read_image
    from ..view.serve import require_libraries, serve
    from ..view.serving import Opening
    from ..view.targets import checked

    require_libraries()
    loaded = load_scene(scene)
    folder, name = (scene.parent, scene.name) if scene.is_file() else (Path(), f"{scene.stem}.toml")
    picture = None if target is None else checked(read_image(target), str(target)).numpy()
    opening = Opening(loaded, folder, name, picture, share)
    # Find out here what is wrong with it
    opening.session()
    serve(opening, typer.echo, port=port, browser=not no_browser)
