"""What the experiments share: a scene, how thoroughly to measure it, and reference images."""

from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Array
from ..inverse.bounds import scales_of, start_of
from ..rendering.samples import check_memory, checked_resolution, render_samples
from ..scene.features import may
from ..scene.files import load_scene
from ..scene.scene import Scene
from ..shapes import Sphere
from .store import Rows
from .timing import in_turns

# Step of the differences that make the reference derivative, over a large change of the parameter.
# Their error falls with the square of the step, until rounding grows; the report shows it.
REFERENCE_STEP = 5e-4


class Setup:
    """A scene in both precisions, and how thoroughly to measure it.

    Args:
        path: the scene file.
        size: width and height, in pixels, of the images whose errors are measured.
        quick: fewer samples, rounds and sizes.
    """

    def __init__(self, path: Path, size: tuple[int, int], quick: bool) -> None:
        self.path, self.size, self.quick = path, checked_resolution(size), quick
        check_memory(*size, 8)
        self.rounds = 3 if quick else 7
        self.single, self.double = load_scene(path), load_scene(path, "double")

    def times(self, calls: Mapping[str, Callable[[], Any]]) -> Rows:
        """Time calls; each row has the call's name, its result ("value") and its times."""
        return [{"name": name, **row} for name, row in in_turns(calls, self.rounds).items()]

    def render(self, scene: Scene, spp: int, **options: Any) -> Array:
        return render_samples(scene, spp, resolution=self.size, **options)

    @cached_property
    def reference(self) -> np.ndarray:
        """The image that errors are relative to: many plain samples, in double precision."""
        spp = 256 if self.quick else 1024
        return self.render(self.double, spp, boundary=False).numpy()

    @cached_property
    def parameter(self) -> tuple[str, str | None]:
        """The parameter whose derivative is measured, and its component.

        It is the index of refraction of a sphere where the scene has one that refracts, or else the
        x coordinate of a sphere, or else that of the camera.
        """
        spheres = [shape for shape in self.single.shapes if isinstance(shape, Sphere)]
        materials = {material.name: material for material in self.single.materials}
        for sphere in spheres:
            if may(self.single, materials[sphere.material], "refraction"):
                return f"materials.{sphere.material}.ior", None
        return (f"spheres.{spheres[0].name}.center" if spheres else "camera.position"), "x"

    @property
    def parameter_label(self) -> str:
        """The parameter in words, such as "spheres.ball.center.x"."""
        name, component = self.parameter
        return f"{name}.{component}" if component else name

    @cached_property
    def step(self) -> float:
        """A large change of that parameter, in its own unit."""
        return float(scales_of(self.double, [self.parameter[0]])[0])

    @cached_property
    def reference_derivative(self) -> np.ndarray:
        """The derivative that errors are relative to, by differences of accurate images."""
        return self.difference(self.double, 64, REFERENCE_STEP * self.step)

    def difference(self, scene: Scene, spp: int, step: float, boundary: bool = True) -> np.ndarray:
        """The derivative of the image by central differences."""
        name, component = self.parameter
        value = start_of(scene, name)
        change = np.zeros(len(value))
        change[component_index(component)] = step
        upper, lower = (
            self.render(scene.replace({name: end.tolist()}), spp, boundary=boundary)
            .numpy()
            .astype(np.float64)
            for end in (value + change, value - change)
        )
        return (upper - lower) / (2 * step)


def component_index(component: str | None) -> int:
    """The index of a vector's component, "x", "y" or "z"; 0 for a number, which has none."""
    return "xyz".index(component) if component else 0


def relative_error(image: np.ndarray, reference: np.ndarray) -> float:
    """The RMS error over the reference's RMS; the RMS error itself where the reference is 0."""
    scale = float(np.sqrt(np.mean(reference**2)))
    error = float(np.sqrt(np.mean((image.astype(np.float64) - reference) ** 2)))
    return error / scale if scale else error
