"""Spheres and lights to add to a scene, to measure how its time grows."""

import math

import drjit as dr
import numpy as np

from ..inverse.bounds import start_of
from ..lights import Light, PointLight
from ..scene.scene import Scene
from ..shapes import Shape, Sphere


def more_spheres(scene: Scene, count: int) -> list[Shape]:
    """Small spheres of the scene's own materials, in a grid around the camera's target."""
    center, half_width = start_of(scene, "camera.look_at"), 0.1 * _view_distance(scene)
    columns = math.ceil(math.sqrt(count))
    materials, precision = scene.used or scene.materials, scene.precision
    radius = half_width / columns
    spheres: list[Shape] = []
    for k in range(count):
        row, column = divmod(k, columns)
        # Four radii from one sphere to the next
        offset = 4 * radius * np.array([column - columns / 2, row - columns / 2, 0.5])
        spheres.append(
            Sphere(
                f"more{k}",
                materials[k % len(materials)].name,
                precision.vector(*(center + offset).tolist()),
                dr.opaque(precision.real, radius),
            )
        )
    return spheres


def more_lights(scene: Scene, count: int) -> list[Light]:
    """Point lights around the camera, together as bright as one of intensity 1."""
    vector, eye = scene.precision.vector, start_of(scene, "camera.position")
    random = np.random.default_rng(0)
    offsets = 0.2 * _view_distance(scene) * random.normal(size=(count, 3))
    intensity = vector(1 / count)
    return [
        PointLight(f"more{k}", vector(*(eye + offset).tolist()), intensity, "none")
        for k, offset in enumerate(offsets)
    ]


def _view_distance(scene: Scene) -> float:
    """The distance from the camera to its target."""
    eye, target = start_of(scene, "camera.position"), start_of(scene, "camera.look_at")
    return float(np.linalg.norm(eye - target))
