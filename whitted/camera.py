"""The pinhole camera: image position to ray.

Image positions are (x, y) in pixels, x right in [0, width], y down in [0, height].
"""

from dataclasses import dataclass

import drjit as dr

from .geometry import NONE, Array, Ray


@dataclass(frozen=True)
class Camera:
    position: Array
    look_at: Array
    up: tuple[float, float, float]
    fov: Array  # vertical, in degrees, in (0, 180)


@dataclass(frozen=True)
class View:
    """A camera made ready for a resolution: direction = normalize(forward + u right + v up), u and v in [-1, 1]."""

    origin: Array
    forward: Array
    right: Array  # as long as half the image plane at distance 1 is wide
    up: Array  # as long as half of it is high


def view(camera: Camera, aspect: Array) -> View:
    """The camera's basis for an image of the given width / height."""
    forward = dr.normalize(camera.look_at - camera.position)
    right = dr.normalize(dr.cross(forward, type(forward)(*camera.up)))
    half_height = dr.tan(dr.deg2rad(camera.fov) / 2)
    return View(camera.position, forward, right * (half_height * aspect), dr.cross(right, forward) * half_height)


def primary_ray(view: View, u: Array, v: Array) -> Ray:
    """The ray through the image position u = 2 x / width - 1, v = 1 - 2 y / height."""
    d = dr.normalize(dr.fma(view.right, u, dr.fma(view.up, v, view.forward)))
    uint, mask = dr.uint32_array_t(type(u)), dr.mask_t(u)
    return Ray(view.origin + dr.zeros(type(d)), d, uint(NONE), mask(False))


def image_ray(view: View, size: Array, x: Array, y: Array) -> Ray:
    """The ray through an image position in pixels; `size` holds the image's width and height."""
    return primary_ray(view, 2 * x / size.x - 1, 1 - 2 * y / size.y)
