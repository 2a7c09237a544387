"""The derivative of an image by one number of its scene, as an image."""

import drjit as dr

from ..core.arrays import Array
from ..files.progress import Report, reporting
from ..scene.scene import Scene, checked_scene
from .api import render

COMPONENTS = ("x", "y", "z")


def gradient(
    scene: Scene,
    name: str,
    component: str | None = None,
    spp: int = 1,
    *,
    error: float | None = None,
    boundary: bool | None = None,
    terms: str = "both",
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    progress: Report | bool | None = None,
) -> Array:
    """Differentiate every pixel by one parameter, in forward mode.

    Args:
        name: of a parameter of the scene, as in `Scene.parameters`; a pattern has to match one.
        component: of a vector, "x", "y" or "z", which are red, green and blue of a colour; None for
            a number. Of a cloud, the number of a sphere comes before: "17.x" of centers, "17" of
            radii.
        spp, error, boundary, terms, max_depth, resolution: as of `render`.
        progress: called with the fraction done, in (0, 1]; the first half is the image, the second
            its derivative. True shows a bar, as of `render`.

    Returns:
        d image / d parameter, of the type and shape of the image.

    Raises:
        TypeError: no scene is given, but its name, say.
        KeyError: a name that the scene does not have; the message lists the nearest ones.
        ValueError: a pattern that matches several names, a component that the parameter does not
            have, a vector without one, or what `render` refuses.

    Example:
        >>> by_x = whitted.gradient(scene, "spheres.ball.center", "x", spp=4)
    """
    checked_scene(scene)
    values = dr.detach(scene.parameters(name))
    if len(values) > 1:
        raise ValueError(f"name: '{name}' stands for {', '.join(values)}; name one of them")
    (name,) = values
    if scene.locations[name].entry.many:
        tangent = _unit_of_one(name, values[name], component)
    else:
        tangent = _unit(name, values[name], component)
    dr.enable_grad(values)
    dr.set_grad(values[name], tangent)
    with reporting(progress, "differentiating") as report:
        image = render(
            scene.replace(values),
            spp,
            error=error,
            boundary=boundary,
            terms=terms,
            max_depth=max_depth,
            resolution=resolution,
            progress=report and _in_halves(report),
        )
        return dr.forward_to(image)


def _unit(name: str, value: Array, component: str | None) -> Array:
    """The tangent along a component of a vector, or along a number."""
    if dr.depth_v(value) == 1:
        if component is not None:
            raise ValueError(f"component: expected none for the number '{name}', got {component}")
        return type(value)(1)
    if component not in COMPONENTS:
        expected = "x, y or z (for red, green or blue of a colour)"
        raise ValueError(
            f"component: expected {expected} for the vector '{name}', got {component or 'none'}"
        )
    return type(value)(*(float(axis == component) for axis in COMPONENTS))


def _unit_of_one(name: str, value: Array, component: str | None) -> Array:
    """The tangent along one number of one sphere of a cloud."""
    vector, count = dr.depth_v(value) == 2, dr.width(value)
    number, _, axis = str(component).partition(".")
    legal = axis in COMPONENTS if vector else not axis
    if not (number.isascii() and number.isdigit() and int(number) < count and legal):
        example = f"'0.x' to '{count - 1}.z'" if vector else f"'0' to '{count - 1}'"
        raise ValueError(
            f"component: expected a sphere of the cloud '{name}', {example}, got {component!r}"
        )
    real = dr.value_t(value) if vector else type(value)
    one = dr.select(dr.arange(dr.uint32_array_t(real), count) == int(number), real(1), 0)
    return type(value)(*(one if own == axis else 0 for own in COMPONENTS)) if vector else one


def _in_halves(progress: Report) -> Report:
    """One count from 0 to 1 of two that follow each other."""
    done = 0.0

    def report(fraction: float) -> None:
        nonlocal done
        progress(done + fraction / 2)
        if fraction >= 1:
            done = 0.5

    return report
