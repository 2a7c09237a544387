"""Chains of rays, followed from surface to surface."""

import drjit as dr
import numpy as np

from ..core.arrays import Array, Precision
from ..core.ray import Ray
from ..scene.scene import Scene
from ..tracing.intersect import closest_hit
from ..tracing.node import scatter
from ..tracing.surface import surface
from .arrays import rays_of


def as_kernels_see(scene: Scene) -> Scene:
    """A scene whose many spheres stand in a tree."""
    return scene.structure.filled(scene.inputs())


def follow(scene: Scene, ray: Ray, kinds: str) -> Ray:
    """Follow rays from surface to surface.

    Args:
        kinds: what happens at each surface: "r", the ray is reflected; "t", it is refracted.

    Returns:
        The rays that leave the last surface.
    """
    for kind in kinds:
        at = surface(scene, ray, closest_hit(scene, ray))
        branch = scatter(scene, ray, at)[-1 if kind == "t" else 0]
        ray = Ray(at.p, branch.direction, at.hit.index, branch.inward)
    return ray


def parallel_rays(p: Precision, height: Array) -> Ray:
    """Rays from z = 5 along -z, at these heights above the z axis, in the direction of x."""
    rays = rays_of(p, np.zeros((3, dr.width(height))), np.array([[0.0], [0.0], [-1.0]]))
    return Ray(type(rays.o)(height, 0, 5), rays.d, rays.source, rays.inward)
