"""The task of a sweep: render some pictures, and write them to the store."""

from dataclasses import dataclass
from pathlib import Path

import drjit as dr
import numpy as np

from ..core.interrupts import held
from ..rendering.samples import render_samples
from ..scene.scene import Scene
from . import store
from .numbers import tangents, with_values
from .plan import Plan


@dataclass(frozen=True)
class Sweep:
    """What the tasks of a sweep share."""

    path: Path  # of the store, on all workers
    plan: Plan


def render_pictures(sweep: Sweep, task: int) -> list[tuple[int, str]]:
    """Render a task's pictures.

    Returns:
        The pictures that the scene refused, with the reason; they are left empty.
    """
    plan, refused = sweep.plan, []
    first, count = plan.pictures(task)
    width, height = plan.resolution
    dtype, shape = plan.scene.precision.dtype, (height, width, 3)
    images = np.full((count, *shape), np.nan, dtype)
    blocks = {store.IMAGE: images}
    if plan.derivatives:
        slopes = np.full((count, len(plan.derivatives), *shape), np.nan, dtype)
        blocks[store.DERIVATIVE] = slopes
    for k, values in enumerate(plan.samples.values(first, count)):
        try:
            scene = with_values(plan.scene, plan.numbers, values)
        except ValueError as error:
            refused.append((first + k, str(error).splitlines()[0]))
            continue
        if plan.derivatives:
            images[k], slopes[k] = with_derivatives(scene, plan)
        else:
            images[k] = render_samples(scene, **plan.options).numpy()
    # Ctrl-C within zarr would leave tasks of its own behind
    held(store.write, sweep.path, plan, task, blocks, bool(refused))
    return refused


def with_derivatives(scene: Scene, plan: Plan) -> tuple[np.ndarray, list[np.ndarray]]:
    """A scene's image, and its derivatives by some numbers. One image is traced for all."""
    names = list(dict.fromkeys(number.name for number in plan.derivatives))
    parameters = scene.parameters(*names)
    dr.enable_grad(parameters)
    image = render_samples(scene.replace(parameters), **plan.options)
    columns = []
    for number in plan.derivatives:
        for name, tangent in tangents(scene, number, names).items():
            dr.set_grad(parameters[name], tangent)
        column = dr.forward_to(image, flags=dr.ADFlag.ClearInterior)
        columns.append(column.numpy())
        dr.clear_grad(image)
    return image.numpy(), columns
