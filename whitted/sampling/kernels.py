"""The kernels of a film: a band's pixels, their tangent in one direction, and their gradient.

Each runs in a frozen function, which skips tracing the Python code when a scene of the same
structure comes again.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import drjit as dr
from drjit.llvm import ad

from ..autodiff.forward import radiance_jvp
from ..autodiff.reverse import radiance_vjp
from ..core.arrays import Array, Parameters
from ..core.frozen import frozen
from ..scene.structure import Structure
from ..tracing.node import Limits
from ..tracing.record import Record
from ..tracing.recursion import radiance
from .differentiated import Forward, Gradients, Names, Reverse, prepare
from .film import Film, next_sample, pixel, sample_ray

# Lanes of the reverse kernel. Each takes many pixels, so that few sums are left to add up
REVERSE_LANES = 1 << 14


def accumulate(
    film: Film,
    of_sample: Callable[[Array, Array, Array, Array], tuple[Array, ...]],
    color: Any,
    count: int = 1,
    writes: bool = False,
) -> tuple[Array, ...]:
    """A band's pixels in some images, row-major with RGB interleaved: the means of their samples.

    Args:
        of_sample: takes the pixel's column and row in the band, and the place (i, j) on the pixel's
            grid; returns the sample's Array3f in each image. It is also called for the margin.
        color: the type of Array3f.
        count: the number of images.
        writes: the function also writes to memory. If not, one sample a pixel takes no loop, and
            lanes that fill up the last blocks are traced as well.
    """
    x, y, valid = pixel(film, dr.arange(ad.Int, film.lanes))

    def sample(i, j, total, active):
        sampled = of_sample(x, y, i, j)
        total = tuple(old + new for old, new in zip(total, sampled, strict=True))
        i, j = next_sample(film, i, j)
        return i, j, total, active & (j < film.side)

    zero, dark = dr.zeros(ad.Int, film.lanes), dr.zeros(color, film.lanes)
    state: Any = zero, zero, (dark,) * count, valid
    if film.single and not writes:
        totals = of_sample(x, y, zero, zero)
    else:
        totals = dr.while_loop(state, lambda *s: s[-1], sample, mode="symbolic", label="samples")[2]
    inside = valid & (x >= 0) & (y >= 0) & (x < film.width) & (y < film.rows)
    images = []
    for total in totals:
        pixels: Array = dr.empty(dr.value_t(color), film.pixels * 3)
        dr.scatter(pixels, total * film.step * film.step, ad.UInt32(y * film.width + x), inside)
        images.append(pixels)
    return tuple(images)


@frozen
def image(
    structure: Structure,
    parameters: Parameters,
    film: Film,
    limits: Limits,
    record: Record | None = None,
) -> Array:
    """A band's pixels, row-major with RGB interleaved.

    Args:
        record: of the film's samples, to be filled in.
    """
    scene, frame = prepare(structure, parameters, film.size)
    lane = dr.arange(ad.Int, film.lanes)

    def of_sample(x, y, i, j):
        note = partial(record.write, _number(film, lane, i, j)) if record is not None else None
        return (radiance(scene, sample_ray(frame, film, x, y, i, j), limits, note),)

    return accumulate(film, of_sample, type(scene.background))[0]


@frozen
def image_jvp(
    structure: Structure,
    parameters: Parameters,
    film: Film,
    limits: Limits,
    wrt: Names,
    tangents: tuple[Parameters, ...],
    weights: Array | None = None,
) -> tuple[Array, ...]:
    """The derivatives of `image` along some tangents of the parameters `wrt`.

    Args:
        weights: what each sample counts for, row by row of samples [default: 1].
    """
    moving = Forward(structure, parameters, film.size, wrt, tangents)

    def of_sample(x, y, i, j):
        rays = moving.rays(lambda frame: sample_ray(frame, film, x, y, i, j))
        slopes = radiance_jvp(moving.directions, *rays, limits)
        if weights is None:
            return slopes
        weight = _weight(film, weights, x, y, i, j)
        return tuple(slope * weight for slope in slopes)

    return accumulate(film, of_sample, structure.precision.vector, len(tangents))


@frozen
def image_vjp(
    structure: Structure,
    parameters: Parameters,
    film: Film,
    limits: Limits,
    wrt: Names,
    adjoint: Array,
    weights: Array | None = None,
    record: Record | None = None,
) -> Gradients:
    """The derivatives of dot(adjoint, image) by the parameters `wrt`.

    Args:
        weights: as those of `image_jvp`.
        record: of the film's samples.
    """
    real, color = structure.precision.real, structure.precision.vector
    lanes = min(film.lanes, REVERSE_LANES)
    stride = dr.minimum(film.count, REVERSE_LANES)
    # Zeros that the compiler cannot see
    reverse = Reverse(structure, parameters, film.size, wrt, real(dr.arange(ad.Int, lanes) >> 31))

    def sample(index, i, j, sums, active):
        x, y, valid = pixel(film, index)
        place = ad.UInt32(y * film.width + x)
        seed = dr.gather(color, adjoint, place, valid) * (film.step * film.step)
        seed = seed if weights is None else seed * _weight(film, weights, x, y, i, j)

        hits = record.hits(_number(film, index, i, j)) if record is not None else None

        def walk(scene, sums, wide, ray):
            return radiance_vjp(scene, sums, wide, ray, seed, limits, reverse.frame_moves, hits)

        sums = reverse.add(sums, lambda frame: sample_ray(frame, film, x, y, i, j), walk)
        i, j = next_sample(film, i, j)
        done = j == film.side
        index = dr.select(done, index + stride, index)
        return index, i, dr.select(done, 0, j), sums, index < film.count

    zero = dr.zeros(ad.Int, lanes)
    state = dr.arange(ad.Int, lanes), zero, zero, reverse.zeros(lanes), dr.ones(ad.Bool, lanes)
    sums = dr.while_loop(state, lambda *s: s[-1], sample, mode="symbolic", label="samples")[3]
    return reverse.gradients(sums)


def _number(film: Film, lane: Array, i: Array, j: Array) -> Array:
    """The number of a lane's sample (i, j) in a record."""
    return ad.UInt32((j * film.side + i) * film.count + lane)


def _weight(film: Film, weights: Array, x: Array, y: Array, i: Array, j: Array) -> Array:
    index = ((y * film.side + j) * film.width + x) * film.side + i
    return dr.gather(type(film.step), weights, ad.UInt32(index), (x < film.width) & (y < film.rows))
