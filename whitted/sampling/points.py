"""Kernels for derivatives of samples at any image position, rather than of those of a film.

Each runs in a frozen function. It has one lane for each of its inputs, whose number may differ from
call to call.
"""

import drjit as dr

from ..autodiff.forward import radiance_jvp
from ..autodiff.reverse import radiance_vjp
from ..core.arrays import Array, Parameters
from ..core.frozen import frozen
from ..scene.structure import Structure
from ..tracing.node import Limits
from ..tracing.primary import image_ray
from ..tracing.record import Record
from .differentiated import Forward, Gradients, Names, Reverse

# The pixel of what is outside of the band
NOWHERE = 0xFFFFFFFF


def in_lanes(x: Array, value: Array) -> Array:
    """The value in as many lanes as x has.

    Without this, a constant of width 1 would keep the width of the call that was recorded.
    """
    other = type(value)(1) if dr.type_v(value) is dr.VarType.Bool else type(value)(77)
    return dr.select(x < dr.inf, value, other)


@frozen
def samples_jvp(
    structure: Structure,
    parameters: Parameters,
    size: Array,
    limits: Limits,
    wrt: Names,
    tangents: tuple[Parameters, ...],
    x: Array,
    y: Array,
    number: Array | None = None,
    record: Record | None = None,
) -> tuple[Array, ...]:
    """The derivatives of radiance at image positions along tangents of the parameters `wrt`.

    Args:
        number: of each sample in a record, if there is one.
    """
    moving = Forward(structure, parameters, size, wrt, tangents)
    rays = moving.rays(lambda frame: image_ray(frame, size, x, y))
    hits = None if record is None else record.hits(number)
    slopes = radiance_jvp(moving.directions, *rays, limits, hits)
    return tuple(in_lanes(x, slope) for slope in slopes)


@frozen
def samples_vjp(
    structure: Structure,
    parameters: Parameters,
    size: Array,
    limits: Limits,
    wrt: Names,
    adjoint: Array,
    pixel: Array,
    weight: Array,
    x: Array,
    y: Array,
    number: Array | None = None,
    record: Record | None = None,
) -> Gradients:
    """The derivatives by `wrt` of dot(adjoint, pixels), where samples add to the pixels.

    Args:
        pixel: the pixel that each sample adds to, or NOWHERE.
        weight: what the sample counts for in it.
        number: of the sample in a record, if there is one.
    """
    lanes = dr.width(x)
    reverse = Reverse(structure, parameters, size, wrt, dr.zeros(type(x), lanes))
    seed = weight * of_pixel(structure, adjoint, pixel)

    hits = None if record is None else record.hits(number)

    def walk(scene, sums, wide, ray):
        return radiance_vjp(scene, sums, wide, ray, seed, limits, reverse.frame_moves, hits)

    sums = reverse.add(reverse.zeros(lanes), lambda frame: image_ray(frame, size, x, y), walk)
    return reverse.gradients(sums)


def of_pixel(structure: Structure, adjoint: Array, pixel: Array) -> Array:
    """The adjoint of pixels, and zero for NOWHERE."""
    return dr.gather(structure.precision.vector, adjoint, pixel, pixel != NOWHERE)
