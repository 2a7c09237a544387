"""From the camera to rays: the image position (x, y) is in pixels, x right in [0, width], y down in
[0, height].
"""

from dataclasses import dataclass

import drjit as dr

from ..core.arrays import Array
from ..core.ray import NONE, Ray
from ..scene.camera import Camera


@dataclass(frozen=True)
class CameraFrame:
    """A camera made ready for a resolution: direction = normalize(forward + u right + v up), u and
    v in [-1, 1].
    """

    origin: Array
    forward: Array
    right: Array  # as long as half the image plane at distance 1 is wide
    up: Array  # as long as half of it is high


def camera_frame(camera: Camera, aspect: Array) -> CameraFrame:
    """The camera's frame for an image of the given width / height."""
    forward = dr.normalize(camera.look_at - camera.position)
    right = dr.normalize(dr.cross(forward, type(forward)(camera.up)))
    half_height = dr.tan(dr.deg2rad(camera.fov) / 2)
    up = dr.cross(right, forward)
    return CameraFrame(camera.position, forward, right * (half_height * aspect), up * half_height)


def primary_ray(frame: CameraFrame, u: Array, v: Array) -> Ray:
    """The ray through the image position u = 2 x / width - 1, v = 1 - 2 y / height."""
    d = dr.normalize(dr.fma(frame.right, u, dr.fma(frame.up, v, frame.forward)))
    uint, mask = dr.uint32_array_t(type(u)), dr.mask_t(u)
    return Ray(frame.origin + dr.zeros(type(d)), d, uint(NONE), mask(False))


def image_ray(frame: CameraFrame, size: Array, x: Array, y: Array) -> Ray:
    """The ray through an image position in pixels; `size` holds the image's width and height."""
    return primary_ray(frame, 2 * x / size.x - 1, 1 - 2 * y / size.y)
