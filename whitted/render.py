"""From a scene to an image: samples, film, tiles, and the derivatives of all of it."""

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, replace

import drjit as dr
from drjit.llvm import ad

from .camera import View, primary_ray, view
from .geometry import Array
from .scene import Scene
from .scene_file import MAX_DEPTH
from .trace import Limits, radiance

# A band of rows is rendered at a time: long enough to keep all cores busy, short enough to report and to stop
BAND_SAMPLES = 1 << 22


@dataclass(frozen=True)
class Film:
    """A band of an image's rows, and the samples of its pixels. All but `pixels` and `lanes` are opaque to kernels."""

    pixels: int
    lanes: int
    width: Array  # UInt32
    rows: Array  # UInt32: rows in this band
    first_row: Array  # UInt32
    blocks_per_row: Array  # UInt32
    size: Array  # Array2f: width and height of the whole image
    side: Array  # UInt32: samples along a pixel's side
    depth: Array  # UInt32


def prepare(scene: Scene, film: Film) -> tuple[Scene, View]:
    """The scene with unit plane normals, and its camera's basis."""
    planes = tuple(replace(plane, normal=dr.normalize(plane.normal)) for plane in scene.planes)
    prepared = replace(scene, planes=planes), view(scene.camera, film.size.x / film.size.y)
    dr.eval(prepared)
    return prepared


def pixels(film: Film) -> tuple[Array, Array, Array]:
    """Column and row in the band of each lane's pixel, and whether it is in the band: 4 x 4 pixels share a packet."""
    index = dr.arange(type(film.width), film.lanes)
    block, within = index >> 4, index & 15
    # A product of floats is exact enough here, and far cheaper than a division of integers
    real = ad.Float64 if film.pixels > 1 << 22 else ad.Float
    block_row = type(index)((real(block) + 0.5) / real(film.blocks_per_row))
    x = (block - block_row * film.blocks_per_row) * 4 + (within & 3)
    y = block_row * 4 + (within >> 2)
    return x, y, (x < film.width) & (y < film.rows)


def sample_ray(view: View, film: Film, x: Array, y: Array, i: Array, j: Array):
    """The primary ray of sample (i, j) of pixel (x, y) of the band."""
    real = type(film.size.x)
    step = dr.rcp(real(film.side))
    px = real(x) + (real(i) + 0.5) * step
    py = real(y + film.first_row) + (real(j) + 0.5) * step
    return primary_ray(view, 2 * px / film.size.x - 1, 1 - 2 * py / film.size.y)


@dr.freeze
def _image(scene: Scene, film: Film) -> Array:
    """A band's pixels: row-major, RGB interleaved."""
    scene, camera = prepare(scene, film)
    x, y, valid = pixels(film)
    limits = Limits(scene.max_depth, film.depth, None)

    def sample(i, j, total, active):
        total = total + radiance(scene, sample_ray(camera, film, x, y, i, j), limits)
        i += 1
        wrap = i == film.side
        i, j = dr.select(wrap, 0, i), dr.select(wrap, j + 1, j)
        return i, j, total, active & (j < film.side)

    zero = dr.zeros(type(x), film.lanes)
    state = zero, zero, dr.zeros(type(scene.background), film.lanes), valid
    _, _, total, _ = dr.while_loop(state, lambda *state: state[-1], sample, mode="symbolic", label="samples")
    real = type(film.size.x)
    total /= real(film.side * film.side)
    image = dr.zeros(real, film.pixels * 3)
    dr.scatter(image, total, y * film.width + x, valid)
    return image


def render(scene: Scene, spp: int = 1) -> Array:
    width, height = scene.resolution
    real = type(scene.camera.fov)
    u = ad.UInt32
    film = Film(width*height, -(-width//4)*-(-height//4)*16, dr.opaque(u, width), dr.opaque(u, height), dr.opaque(u, 0), dr.opaque(u, -(-width//4)), ad.Array2f(dr.opaque(real, width), dr.opaque(real, height)), dr.opaque(u, int(spp**.5)), dr.opaque(u, scene.max_depth))
    return ad.TensorXf(_image(scene, film), (height, width, 3))
