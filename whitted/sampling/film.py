"""The film: which samples a band of an image has, and in which order they are traced."""

from dataclasses import dataclass

import drjit as dr
from drjit.llvm import ad

from ..core.arrays import Array, Precision
from ..core.ray import Ray
from ..tracing.primary import CameraFrame, image_ray


@dataclass(frozen=True)
class Film:
    """A band of rows of an image.

    All but the first four fields are opaque to kernels, so that one kernel serves every image;
    but images of one sample a pixel have kernels of their own, without a loop over samples.
    """

    pixels: int
    lanes: int  # pixels and their margin, rounded up to whole 4 x 4 blocks
    labels: int  # samples, those of the margin included
    single: bool  # one sample a pixel
    count: Array  # Int: the same as `lanes`
    width: Array  # Int
    rows: Array  # Int: rows in this band
    margin: Array  # Int: pixels around the band that are traced for their labels
    row_of_blocks: Array  # Int: lanes in a row of 4 x 4 blocks
    side: Array  # Int: samples along a pixel's side
    first_row: Array  # as a real number, like the rest
    step: Array  # distance between samples, in pixels
    size: Array  # Array2f: width and height of the whole image


def film_of(
    resolution: tuple[int, int],
    first_row: int,
    rows: int,
    side: int,
    precision: Precision,
    margin: int = 0,
) -> Film:
    """The film of some rows of an image.

    Args:
        resolution: width and height of the whole image.
        rows: so few that the band has less than 2^23 lanes.
        side: samples along a pixel's side.
        margin: pixels to add around the band.
    """
    width, height = resolution
    real = precision.real
    blocks = -(-(width + 2 * margin) // 4)
    lanes = 16 * blocks * -(-(rows + 2 * margin) // 4)
    return Film(
        pixels=width * rows,
        lanes=lanes,
        labels=(width + 2 * margin) * (rows + 2 * margin) * side**2,
        single=side == 1,
        count=dr.opaque(ad.Int, lanes),
        width=dr.opaque(ad.Int, width),
        rows=dr.opaque(ad.Int, rows),
        margin=dr.opaque(ad.Int, margin),
        row_of_blocks=dr.opaque(ad.Int, 16 * blocks),
        side=dr.opaque(ad.Int, side),
        first_row=dr.opaque(real, first_row),
        step=dr.opaque(real, 1 / side),
        size=precision.vector2(dr.opaque(real, width), dr.opaque(real, height)),
    )


def pixel(film: Film, index: Array) -> tuple[Array, Array, Array]:
    """Column and row in the band of a lane's pixel, and whether it is in the band or its margin.

    A packet is 4 x 4 pixels.
    """
    # Below 2^23 the quotient of floats is exact, and far cheaper than one of integers
    row = ad.Int((ad.Float(index) + 0.5) / ad.Float(film.row_of_blocks))
    within = index - row * film.row_of_blocks
    x, y = ((within >> 4) << 2) + (within & 3), (row << 2) + ((within >> 2) & 3)
    x, y = x - film.margin, y - film.margin
    return x, y, (x < film.width + film.margin) & (y < film.rows + film.margin)


def next_sample(film: Film, i: Array, j: Array) -> tuple[Array, Array]:
    """The sample after (i, j) on a pixel's grid, row by row; after the last one, j is `side`."""
    wraps = i + 1 == film.side
    return dr.select(wraps, 0, i + 1), dr.select(wraps, j + 1, j)


def sample_ray(frame: CameraFrame, film: Film, x: Array, y: Array, i: Array, j: Array) -> Ray:
    """The primary ray of a pixel's sample (i, j), at ((i + 1/2) / side, (j + 1/2) / side) within
    the pixel.
    """
    real = type(film.step)
    x = dr.fma(real(i) + 0.5, film.step, real(x))
    y = dr.fma(real(j) + 0.5, film.step, real(y) + film.first_row)
    return image_ray(frame, film.size, x, y)
