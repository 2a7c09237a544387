"""All experiments of a report: a scene's errors, and how its time and memory grow."""

from collections.abc import Callable

from .derivative_errors import gradient, modes
from .image_errors import depth, image, importance
from .scaling import lights, memory, parameters, pixels, spheres, unrolled
from .setup import Setup
from .store import Rows

# By the name of their group, in the order in which they run: the most useful first
EXPERIMENTS: dict[str, Callable[[Setup], Rows]] = {
    "image": image,
    "depth": depth,
    "importance": importance,
    "gradient": gradient,
    "modes": modes,
    "unrolled": unrolled,
    "pixels": pixels,
    "spheres": spheres,
    "lights": lights,
    "parameters": parameters,
    "memory": memory,
}
