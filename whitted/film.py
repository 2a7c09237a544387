"""The film: which samples a band of an image has, and in which order they are traced."""

from dataclasses import dataclass

import drjit as dr
from drjit.llvm import ad

from .camera import View, primary_ray
from .geometry import Array, Ray


@dataclass(frozen=True)
class Film:
    """A band of rows of an image. All but the first two are opaque to kernels, so that one serves every image."""

    pixels: int
    lanes: int  # pixels, rounded up to whole 4 x 4 blocks
    count: Array  # Int: the same
    width: Array  # Int
    rows: Array  # Int: rows in this band
    row_of_blocks: Array  # Int: lanes in a row of 4 x 4 blocks
    side: Array  # Int: samples along a pixel's side
    first_row: Array  # as a real number, like the rest
    step: Array  # distance between samples, in pixels
    size: Array  # Array2f: width and height of the whole image


def band(resolution: tuple[int, int], first_row: int, rows: int, side: int, real: type) -> Film:
    """The film of some rows of an image.

    Args:
        resolution: width and height of the whole image.
        rows: so few that the band has less than 2^23 lanes.
        side: samples along a pixel's side.
        real: the Dr.Jit type of positions.
    """
    width, height = resolution
    blocks = -(-width // 4)
    lanes = 16 * blocks * -(-rows // 4)
    vector = ad.Array2f if real is ad.Float else ad.Array2f64
    return Film(
        pixels=width * rows,
        lanes=lanes,
        count=dr.opaque(ad.Int, lanes),
        width=dr.opaque(ad.Int, width),
        rows=dr.opaque(ad.Int, rows),
        row_of_blocks=dr.opaque(ad.Int, 16 * blocks),
        side=dr.opaque(ad.Int, side),
        first_row=dr.opaque(real, first_row),
        step=dr.opaque(real, 1 / side),
        size=vector(dr.opaque(real, width), dr.opaque(real, height)),
    )


def pixel(film: Film, index: Array) -> tuple[Array, Array, Array]:
    """Column and row in the band of a lane's pixel, and whether it is in the band: 4 x 4 pixels share a packet."""
    # Below 2^23 the quotient of floats is exact, and far cheaper than one of integers
    row = ad.Int((ad.Float(index) + 0.5) / ad.Float(film.row_of_blocks))
    within = index - row * film.row_of_blocks
    x, y = ((within >> 4) << 2) + (within & 3), (row << 2) + ((within >> 2) & 3)
    return x, y, (x < film.width) & (y < film.rows)


def next_sample(film: Film, i: Array, j: Array) -> tuple[Array, Array]:
    """The sample after (i, j) on a pixel's grid, row by row; after the last one, j is `side`."""
    wraps = i + 1 == film.side
    return dr.select(wraps, 0, i + 1), dr.select(wraps, j + 1, j)


def sample_ray(view: View, film: Film, x: Array, y: Array, i: Array, j: Array) -> Ray:
    """The primary ray of a pixel's sample (i, j), at ((i + 1/2) / side, (j + 1/2) / side) within the pixel."""
    real = type(film.step)
    u = dr.fma(real(i) + 0.5, film.step, real(x))
    v = dr.fma(real(j) + 0.5, film.step, real(y) + film.first_row)
    return primary_ray(view, 2 * u / film.size.x - 1, 1 - 2 * v / film.size.y)
