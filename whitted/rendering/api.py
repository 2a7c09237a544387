"""`render`: an image at so many samples, or of so small an error."""

from ..core.arrays import Array
from ..files.progress import Report, reporting
from ..scene.scene import Scene, checked_scene
from .auto_samples import recommend
from .samples import render_samples


def render(
    scene: Scene,
    spp: int = 1,
    *,
    error: float | None = None,
    boundary: bool | None = None,
    terms: str = "both",
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    rows: tuple[int, int] | None = None,
    unroll: int | None = None,
    progress: Report | bool | None = None,
) -> Array:
    """Render a scene, differentiably in the parameters that `Scene.replace` gave it.

    Several threads may render and differentiate; they wait for each other. Ctrl-C raises
    `KeyboardInterrupt`, here and in `dr.backward`.

    Args:
        spp: samples a pixel, a perfect square n * n; they sit on a regular n x n grid.
        error: choose spp and boundary so that the image's relative error is at most this, at the
            least cost. The relative error is the root mean square of the error over that of the
            image.
        boundary: find the edges between samples, correct the pixels by them, and add to the
            derivatives what moving edges contribute [default]. False gives plain samples and their
            derivatives, which miss that.
        terms: of the derivatives: "both", or only the "interior" or the "boundary" term of their
            sum.
        max_depth: nodes on the longest chain of rays, in place of the scene's.
        resolution: width and height in pixels, in place of the scene's.
        rows: the first row and the number of rows of a band of the image, counted from 0 at the
            top. Its pixels are those of the whole image, to the last bit; derivatives of bands add
            up to that of the whole. Not with error.
        unroll: levels of the tree of rays that are straight code, in front of a loop for the rest.
            0 is the loop alone; from max_depth on there is no loop. It changes time and compile
            time, and pixels by rounding. At most 6 where materials both reflect and refract, or
            else 64 [default: as pays in the scene].
        progress: called with the fraction done, in (0, 1], after each part of the work. True
            shows a bar on standard error within a second, if that is a terminal.

    Returns:
        Linear RGB radiance, a `TensorXf` (`TensorXf64` in double precision) of shape (height,
        width, 3); of rows, (count, width, 3).

    Raises:
        TypeError: no scene is given, but its name, say.
        ValueError: an argument is out of range, or the image does not fit in memory; or edges are
            asked for in a function that `drjit.freeze` records.

    Example:
        >>> scene = whitted.load_scene("scenes/cornell.toml")
        >>> image = whitted.render(scene, spp=4)
    """
    checked_scene(scene)
    if error is not None:
        for name, given in (("spp", spp != 1), ("boundary", boundary is not None)):
            if given:
                raise ValueError(f"error: chooses {name} itself; leave {name} out, or error")
        if rows is not None:
            raise ValueError(
                "rows: error may choose other samples for each band; give spp in place of error"
            )
        if terms != "both":
            raise ValueError(
                f"error: may choose boundary=False, which has no terms={terms!r}; leave terms out, "
                "or error"
            )
        chosen = recommend(scene, error, max_depth, resolution)
        spp, boundary = chosen.spp, chosen.boundary
    with reporting(progress, "rendering") as report:
        return render_samples(
            scene,
            spp,
            boundary=boundary is None or boundary,
            terms=terms,
            max_depth=max_depth,
            resolution=resolution,
            rows=rows,
            unroll=unroll,
            progress=report,
        )
