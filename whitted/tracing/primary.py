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
    v in pixels from the middle of the image.
    """

    origin: Array
    forward: Array
    right: Array  # as long as a pixel is wide, on the image plane at distance 1
    up: Array  # as long


def camera_frame(camera: Camera, height: Array) -> CameraFrame:
    """The camera's frame for an image of so many pixels in height."""
    forward = dr.normalize(camera.look_at - camera.position)
    right = dr.normalize(dr.cross(forward, type(forward)(camera.up)))
    up = dr.cross(right, forward)
    pixel = 2 * dr.tan(dr.deg2rad(camera.fov) / 2) / height
    return CameraFrame(camera.position, forward, right * pixel, up * pixel)


def image_ray(frame: CameraFrame, size: Array, x: Array, y: Array) -> Ray:
    """The ray through an image position in pixels; `size` holds the image's width and height."""
    # Exact: halves and positions of samples have few digits
    u, v = dr.fma(size.x, -0.5, x), dr.fma(size.y, 0.5, -y)
    d = dr.normalize(dr.fma(frame.right, u, dr.fma(frame.up, v, frame.forward)))
    uint, mask = dr.uint32_array_t(type(u)), dr.mask_t(u)
    return Ray(frame.origin + dr.zeros(type(d)), d, uint(NONE), mask(False))
