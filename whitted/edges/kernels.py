"""The kernels of the boundary term: samples with labels, crossings, and the motion of edges.

Each runs in a frozen function. All but the first have one lane for each of their inputs. The number
of inputs may differ from call to call.
"""

from dataclasses import replace
from functools import partial

import drjit as dr
from drjit.llvm import ad

from ..autodiff.forward import Direction, radiance_jvp
from ..core.arrays import Array, Parameters
from ..core.frozen import frozen
from ..core.pytree import leaves, like
from ..sampling.differentiated import Forward, Gradients, Names, Reverse, prepare
from ..sampling.film import Film, sample_ray
from ..sampling.kernels import accumulate
from ..sampling.points import in_lanes, of_pixel
from ..scene.features import weights_vary
from ..scene.structure import Structure
from ..tracing.node import Limits
from ..tracing.primary import image_ray
from ..tracing.record import Hits, Record
from . import settings
from .between import Between, edge_between
from .events import reaching
from .labels import labelled_in_parts, labelled_radiance
from .locate import Crossing, Segment, cross
from .motion import Edge, level_jvp, level_vjp
from .paths import partial_light
from .representation import representation
from .slopes import Line, Shot, image_slopes


def crowds_everywhere(structure: Structure) -> bool:
    """Whether all pixels with edges are crowds: among many mirrors, or among very many spheres
    where anything mirrors or refracts.
    """
    many = structure.reflects and structure.in_tree > settings.MOST_SEARCHED
    return many or structure.mirrors > settings.MOST_MIRRORS


@frozen
def labelled_image(
    structure: Structure,
    parameters: Parameters,
    film: Film,
    limits: Limits,
    record: Record | None = None,
) -> tuple[Array, ...]:
    """A band's pixels, and the labels of its samples and of those in its margin, row by row.

    Where crowds are everywhere, the light of dim rays alone is the second image.

    Args:
        record: to be filled in where crowds are everywhere, with one sample a pixel. A sample's
            number is that of its pixel; those in the margin share the last number.
    """
    scene, frame = prepare(structure, parameters, film.size)
    labels = dr.empty(ad.UInt64 if weights_vary(scene) else ad.UInt32, film.labels)
    row = (film.width + 2 * film.margin) * film.side
    # Labels depend on the order of nodes, which some levels in front of a loop would change
    levels = min(limits.levels, 1) if limits.loops else limits.levels
    in_parts = crowds_everywhere(structure)

    def of_sample(x, y, i, j):
        ray = sample_ray(frame, film, x, y, i, j)
        if in_parts:
            inside = (x >= 0) & (y >= 0) & (x < film.width) & (y < film.rows)
            note = None
            if record is not None:
                number = dr.select(inside, ad.UInt32(y * film.width + x), record.samples - 1)
                note = partial(record.write, number)
            *colors, label = labelled_in_parts(scene, ray, limits, _dim(limits), levels, note)
        else:
            *colors, label = labelled_radiance(scene, ray, limits, levels=levels)
        place = ((y + film.margin) * film.side + j) * row + (x + film.margin) * film.side + i
        dr.scatter(labels, label, ad.UInt32(place))
        return tuple(colors)

    images = accumulate(film, of_sample, type(scene.background), 1 + in_parts, writes=True)
    return *images, labels


@frozen
def rows_of_samples(
    structure: Structure,
    parameters: Parameters,
    size: Array,
    limits: Limits,
    x: Array,
    y: Array,
    step: Array,
    count: Array,
    dim: Array,
) -> Array:
    """The sum of radiance along rows of samples.

    Args:
        x, y: image position of the first sample of each row.
        step, count: the distance of the samples, and how many they are.
        dim: Bool: of dim rays; else of all others.
    """
    scene, frame = prepare(structure, parameters, size)

    def sample(k, total):
        ray = image_ray(frame, size, x + step * type(x)(k), y)
        return k + 1, total + partial_light(scene, ray, limits, _dim(limits), dim)

    state = dr.zeros(ad.UInt, dr.width(x)), dr.zeros(type(scene.background), dr.width(x))
    return dr.while_loop(state, lambda k, _: k < count, sample, mode="symbolic", label="row")[1]


@frozen
def labelled_samples(
    structure: Structure,
    parameters: Parameters,
    size: Array,
    limits: Limits,
    x: Array,
    y: Array,
    bright: Array,
    record: Record | None = None,
    number: Array | None = None,
) -> tuple[Array, Array]:
    """Radiance of samples at image positions, and their labels.

    Args:
        bright: Bool: without that of dim rays.
        record: of the samples, to be filled in.
        number: of each sample in the record [default: that of its lane].
    """
    scene, frame = prepare(structure, parameters, size)
    least, lane = dr.select(bright, _dim(limits), 0), dr.arange(ad.UInt32, dr.width(x))
    place = lane if number is None else number
    note = partial(record.write, place) if record is not None else None
    ray = image_ray(frame, size, x, y)
    color, label = labelled_radiance(scene, ray, limits, least, note=note)
    return in_lanes(x, color), in_lanes(x, label)


@frozen
def edges_between(
    structure: Structure,
    parameters: Parameters,
    size: Array,
    limits: Limits,
    line: Line,
    a: Array,
    b: Array,
    record: Record | None,
) -> Between:
    """The edges between samples that are close to each other.

    Args:
        a, b: the numbers of the samples at the ends of the lines.
        record: of all samples that were traced.
    """
    shot = Shot(*prepare(structure, parameters, size), size, limits)
    hits = (None, None) if record is None else (record.hits(a), record.hits(b))
    found = edge_between(shot, line, _dim(limits), hits)
    return like(found, [in_lanes(line.x, array) for array in leaves(found)])


@frozen
def representative(
    structure: Structure,
    parameters: Parameters,
    size: Array,
    limits: Limits,
    x: Array,
    y: Array,
    place: Array,
    row: Array,
    step: Array,
    color: Array,
    label: Array,
    number: Array,
    record: Record | None,
) -> Array:
    """How well samples' derivatives stand for their cells, as `representation` says.

    Args:
        place: of each sample in its block; 0 for none, as in lanes that fill up the last packet.
        row: how many places further the sample below is.
        step: the distance of neighbours.
        color, label: of all samples that were traced.
        number: for each place, the number of its sample among those.
        record: of those samples.
    """
    shot = Shot(*prepare(structure, parameters, size), size, limits)

    def numbered(where):
        return dr.gather(type(number), number, where, place > 0)

    def traced(where):
        which = numbered(where)
        return tuple(dr.gather(type(of), of, which, place > 0) for of in (color, label))

    hits = None if record is None else record.hits(numbered(place))
    slopes = slopes_at(shot, x, y, hits)
    around = [(traced(place - way), traced(place + way)) for way in (1, row)]
    return in_lanes(x, representation(traced(place), around, slopes, step))


def slopes_at(shot: Shot, x: Array, y: Array, hits: Hits | None) -> tuple[Array, ...]:
    """The slopes of radiance in the image, to the right and down, without that of dim rays."""
    least = _dim(shot.limits)
    if shot.limits.importance is not None:
        least = dr.fmax(least, shot.limits.importance)
    limits = replace(shot.limits, importance=least)
    at_rest = [Direction(shot.scene, {})] * 2
    return radiance_jvp(at_rest, *image_slopes(shot, (x, y)), limits, hits)


def _dim(limits: Limits) -> Array:
    """The weight below which rays are too dim for derivatives of samples that stand for a part of a
    pixel.
    """
    least = limits.faint * (settings.LEAST_WEIGHT_BESIDE / settings.LEAST_WEIGHT)
    return dr.fmin(least, settings.MOST_WEIGHT_BESIDE)


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
    wrt: Names,
    tangents: tuple[Parameters, ...],
    x: Array,
    y: Array,
    edge: Edge,
    number: Array | None = None,
    record: Record | None = None,
) -> tuple[Array, ...]:
    """The derivatives of edges' level functions along some tangents of the parameters `wrt`.

    Args:
        number: of a sample beside each edge in a record, if there is one.
    """
    moving = Forward(structure, parameters, size, wrt, tangents)
    rays = moving.rays(lambda frame: image_ray(frame, size, x, y))
    hits = None if record is None else reaching(moving.directions[0].scene, record.hits(number))
    slopes, _ = level_jvp(moving.directions, *rays, limits, edge, hits)
    return tuple(in_lanes(x, slope.level) for slope in slopes)


@frozen
def levels_vjp(
    structure: Structure,
    parameters: Parameters,
    size: Array,
    limits: Limits,
    wrt: Names,
    adjoint: Array,
    pixels: Array,
    change: Array,
    jump: Array,
    x: Array,
    y: Array,
    edge: Edge,
    number: Array | None = None,
    record: Record | None = None,
) -> Gradients:
    """The derivatives by `wrt` of dot(adjoint, pixels), where edges change the pixels.

    Args:
        pixels: Array2u, the two pixels that an edge changes.
        change: Array2f, by how much of the jump.
        number: as that of `levels_jvp`.
    """
    lanes = dr.width(x)
    reverse = Reverse(structure, parameters, size, wrt, dr.zeros(type(x), lanes))
    seed = sum(change[k] * dr.dot(of_pixel(structure, adjoint, pixels[k]), jump) for k in range(2))

    def walk(scene, sums, wide, ray):
        hits = None if record is None else reaching(scene, record.hits(number))
        return level_vjp(scene, sums, wide, ray, seed, limits, edge, hits)

    sums = reverse.add(reverse.zeros(lanes), lambda frame: image_ray(frame, size, x, y), walk)
    return reverse.gradients(sums)
