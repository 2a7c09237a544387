"""The kernels of the boundary term: samples with labels, crossings, and the motion of edges.

Each runs in a frozen function. All but the first have one lane for each of their inputs. The number
of inputs may differ from call to call.
"""

import drjit as dr
from drjit.llvm import ad

from ..core.arrays import Array, Parameters
from ..core.frozen import frozen
from ..core.pytree import leaves, like
from ..sampling.differentiated import Forward, Reverse, prepare
from ..sampling.film import Film, sample_ray
from ..sampling.kernels import accumulate
from ..sampling.points import in_lanes, of_pixel
from ..scene.features import weights_vary
from ..scene.structure import Structure
from ..tracing.node import Limits
from ..tracing.primary import image_ray
from .labels import labelled_radiance
from .locate import Crossing, Segment, Shot, cross
from .motion import Edge, level_jvp, level_vjp


@frozen
def labelled_image(
    structure: Structure, parameters: Parameters, film: Film, limits: Limits
) -> tuple[Array, Array]:
    """A band's pixels, and the labels of its samples and of those in its margin, row by row."""
    scene, frame = prepare(structure, parameters, film.size)
    labels = dr.empty(ad.UInt64 if weights_vary(scene) else ad.UInt32, film.labels)
    row = (film.width + 2 * film.margin) * film.side

    def of_sample(x, y, i, j):
        color, label = labelled_radiance(scene, sample_ray(frame, film, x, y, i, j), limits)
        place = ((y + film.margin) * film.side + j) * row + (x + film.margin) * film.side + i
        dr.scatter(labels, label, ad.UInt32(place))
        return color

    return accumulate(film, of_sample, type(scene.background)), labels


@frozen
def labelled_samples(
    structure: Structure, parameters: Parameters, size: Array, limits: Limits, x: Array, y: Array
) -> tuple[Array, Array]:
    """Radiance of samples at image positions, and their labels."""
    scene, frame = prepare(structure, parameters, size)
    color, label = labelled_radiance(scene, image_ray(frame, size, x, y), limits)
    return in_lanes(x, color), in_lanes(x, label)


@frozen
def crossings(
    structure: Structure, parameters: Parameters, size: Array, limits: Limits, segment: Segment
) -> Crossing:
    """Where edges cross segments between samples of different labels."""
    found = cross(Shot(*prepare(structure, parameters, size), size, limits), segment)
    return like(found, [in_lanes(segment.x, array) for array in leaves(found)])


@frozen
def levels_jvp(
    structure: Structure,
    parameters: Parameters,
    size: Array,
    limits: Limits,
    wrt: Parameters,
    tangents: Parameters,
    x: Array,
    y: Array,
    edge: Edge,
) -> Array:
    """The derivative of edges' level functions along the tangents of the parameters `wrt`."""
    moving = Forward(structure, parameters, size, wrt, tangents)
    ray, o, d = moving.ray(lambda frame: image_ray(frame, size, x, y))
    (slope,), _ = level_jvp(moving.scene, moving.tangents, ray, [(o, d)], limits, edge)
    return in_lanes(x, slope.level)


@frozen
def levels_vjp(
    structure: Structure,
    parameters: Parameters,
    size: Array,
    limits: Limits,
    wrt: Parameters,
    adjoint: Array,
    pixels: Array,
    change: Array,
    jump: Array,
    x: Array,
    y: Array,
    edge: Edge,
) -> Parameters:
    """The derivatives by `wrt` of dot(adjoint, pixels), where edges change the pixels.

    Args:
        pixels: Array2u, the two pixels that an edge changes.
        change: Array2f, by how much of the jump.
    """
    lanes = dr.width(x)
    reverse = Reverse(structure, parameters, size, wrt, dr.zeros(type(x), lanes))
    seed = sum(change[k] * dr.dot(of_pixel(structure, adjoint, pixels[k]), jump) for k in range(2))

    def walk(scene, sums, wide, ray):
        return level_vjp(scene, sums, wide, ray, seed, limits, edge)

    sums = reverse.add(reverse.zeros(lanes), lambda frame: image_ray(frame, size, x, y), walk)
    return reverse.gradients(sums)
