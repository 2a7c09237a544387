"""Error against time of an image's derivative by one parameter: by method, by mode of AD."""

from collections.abc import Callable
from functools import partial
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array
from ..core.host import to_array
from ..files.images import as_numpy
from ..rendering.gradient import gradient as differentiate
from ..rendering.samples import render_samples
from ..scene.scene import Scene
from .setup import REFERENCE_STEP, Setup, component_index, relative_error
from .store import Rows

# Methods of automatic differentiation: name, and whether with the boundary term
METHODS = (("plain AD", False), ("boundary", True))


def gradient(setup: Setup) -> Rows:
    """The derivative's image by plain AD, by AD with edges, and by differences of plain samples."""
    calls: dict[str, Callable[[], Any]] = {}
    for kind, boundary in METHODS:
        for spp in (1, 4, 16):
            calls[f"{kind}, spp {spp}"] = partial(
                _derivative, setup, setup.single, spp, boundary=boundary
            )
    calls["boundary, float64, spp 4"] = partial(_derivative, setup, setup.double, 4)
    for factor in (0.3, 0.1, 0.03, 0.01):
        for spp in (4, 16):
            calls[f"differences, step {factor:g}, spp {spp}"] = partial(
                setup.difference, setup.single, spp, factor * setup.step, boundary=False
            )
    rows = setup.times(calls)
    for row in rows:
        row["kind"] = row["name"].split(",")[0]
        row["error"] = relative_error(as_numpy(row.pop("value")), setup.reference_derivative)
    # Differences with twice the step differ from the reference by about the reference's error
    other = setup.difference(setup.double, 64, 2 * REFERENCE_STEP * setup.step)
    error = relative_error(other, setup.reference_derivative)
    return [*rows, {"kind": "floor", "name": "error of the reference", "error": error}]


def modes(setup: Setup) -> Rows:
    """Forward and reverse mode, by the parameter alone and by all parameters of the scene.

    Reverse mode gives no image of the derivative, only sums. So both modes compute the same sum
    over pixels and channels: the derivative times the reference, over the reference squared. It is
    1 where the derivative is right.
    """
    name, _ = setup.parameter
    weights = setup.reference_derivative / np.sum(setup.reference_derivative**2)
    calls: dict[str, Callable[[], float]] = {}
    for kind, boundary in METHODS:
        for scene in (setup.single, setup.double) if boundary else (setup.single,):
            parameters = {"one": [name], "all": sorted({name, *scene.features.live})}
            for spp in (1, 4):
                options = {"spp": spp, "boundary": boundary, "resolution": setup.size}
                end = f"{scene.precision.name}, spp {spp}"
                calls[f"{kind}, forward, {end}"] = partial(
                    _forward, scene, setup.parameter, weights, options
                )
                for which, names in parameters.items():
                    calls[f"{kind}, reverse, {which}, {end}"] = partial(
                        _reverse, scene, setup.parameter, names, weights, options
                    )
    rows = setup.times(calls)
    for row in rows:
        row["kind"] = row["name"].rsplit(", ", 2)[0]
        row["error"] = abs(row.pop("value") - 1)
    return rows


def _derivative(setup: Setup, scene: Scene, spp: int, boundary: bool = True) -> Array:
    options: dict[str, Any] = {"boundary": boundary, "resolution": setup.size}
    return differentiate(scene, *setup.parameter, spp, **options)


def _forward(
    scene: Scene, parameter: tuple[str, str | None], weights: np.ndarray, options: dict[str, Any]
) -> float:
    """A weighted sum of the image's derivative by one parameter, in forward mode."""
    return float(np.sum(differentiate(scene, *parameter, **options).numpy() * weights))


def _reverse(
    scene: Scene,
    parameter: tuple[str, str | None],
    names: list[str],
    weights: np.ndarray,
    options: dict[str, Any],
) -> float:
    """The same sum in reverse mode, as one of the derivatives by all parameters of `names`."""
    values = dr.detach(scene.parameters(*names))
    dr.enable_grad(values)
    image = render_samples(scene.replace(values), **options)
    seed = to_array(weights.ravel().astype(scene.precision.dtype), weights.size)
    dr.backward(dr.sum(image.array * seed))
    name, component = parameter
    return float(np.ravel(dr.grad(values[name]).numpy())[component_index(component)])
