"""Where an edge crosses the segment between two neighbouring samples, and what of it each sample's cell has."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
from drjit.llvm import ad

from .camera import View, image_ray
from .chain import Arrival, Path, contrasted, follow, heavier, strongest_difference
from .decisions import CELLS, Decisions, decide, differ, flips
from .derivative import Edge, level_jvp, push_forward
from .events import CELL, NOTHING, SILHOUETTE, TOTAL, classify, crease_cosines, level_function, place
from .geometry import Array, Ray
from .scene import Scene, closest_hit
from .surface import checkers, surface
from .trace import Limits, children

# A level at one end of a segment, relative to the one at the other end, below which the edge is at that end
ON_SAMPLE = 2.0**-12
# Pairs that account for less of an edge have no samples of their own beside it, and those that account for the rest all
SLIGHT = 0.3
# Halvings of a segment before its event is told from what lies at its ends, and most steps to the level function's root
HALVINGS = 1
STEPS = 20
# Cells of a checkerboard from one sample to the next, up to which their edges' motion counts in full (from CELLS on it does
# not), and how many cells away that is so, at half of which all motion counts
FINE = 1
FAR = 16
# A cosine at which a surface is met, in units of how far the ray turns from one sample to the next, below which the surface
# runs off into the distance between the two
GRAZING = 1 / 4


@dataclass
class Segment:
    """What is to be searched of the line from a sample a to its right or lower neighbour b.

    Distances are from a, in pixels. (Not frozen: Dr.Jit's loops write to their state.)
    """

    x: Array  # image position of a
    y: Array
    vertical: Array  # Bool: b is below, not to the right
    length: Array  # from a to b
    start: Array
    stop: Array
    label_start: Array  # UInt32 or UInt64: the labels at start and stop
    label_stop: Array

    def at(self, along: Array) -> tuple[Array, Array]:
        """The image position at a distance from a."""
        return self.x + dr.select(self.vertical, 0, along), self.y + dr.select(self.vertical, along, 0)


@dataclass
class Crossing:
    """An edge between a and b. What it moves from one sample's cell to the other's is a multiple of its jump."""

    found: Array  # Bool
    along: Array  # distance from a
    moved: Array  # Array2f: what the cells of a and of b gain as the edge is not midway, and at an angle to the segment
    change: Array  # Array2f: what they gain as the level function grows
    weight: Array  # the share of the edge that pairs of this direction account for; those of the other have the rest
    singular: Array  # Bool: near the edge radiance changes like the square root of the distance, or faster, and enough to matter
    behind: Array  # Bool: it does so behind the edge, not before it
    jump: Array  # Array3f: radiance right before the edge less that right behind it
    label_before: Array  # UInt32 or UInt64: the labels there
    label_behind: Array
    more_before: Array  # Bool: another edge is between start and this one
    more_behind: Array
    gap: Array  # from the edge to right before and right behind, in pixels
    edge: Edge


def cross(scene: Scene, camera: View, size: Array, segment: Segment, limits: Limits) -> Crossing:
    """Find an edge in a segment, and look at both its sides."""
    along, edge, reach = _locate(scene, camera, size, segment, limits)
    slope, across, counts, (on, other) = _slopes(scene, camera, size, segment, along, limits, edge)
    single = type(along) is ad.Float
    valid = (edge.event.kind != NOTHING) & dr.isfinite(along) & dr.isfinite(slope) & dr.isfinite(across) & (slope != 0)
    ulp = (2.0**-23 if single else 2.0**-52) * dr.fmax(size.x, size.y)
    gap = dr.fmax(segment.length * (2.0**-10 if single else 1e-6), 8 * ulp)
    color, label = _both_sides(
        scene,
        lambda k: image_ray(camera, size, *segment.at(along + dr.select(k == 0, -gap, gap))),
        edge.path,
        type(segment.label_start),
        limits,
        valid,
    )
    found = valid & differ(*label)

    rooted = (edge.event.kind == SILHOUETTE) | (edge.event.kind == TOTAL)
    grazes = (on < GRAZING) | (other < GRAZING)

    # Scaled, as fourth powers leave the range of single precision
    largest = dr.fmax(dr.abs(slope), dr.abs(across))
    u, v = dr.square(slope / largest), dr.square(across / largest)
    weight = dr.select(valid, u * u / dr.fma(u, u, v * v), 0)
    # How far the edge moves along the pair from one line of samples to the next, halved
    tilt = segment.length / 2 * dr.fmin(dr.fmax(dr.abs(across / slope), 1e-6), 1)
    past = along - segment.length / 2
    straight = dr.fmin(past, 0)
    a = dr.select(dr.abs(past) < tilt, -(tilt - past) * (tilt - past) / (4 * tilt), straight)
    vector = type(size)
    moved = vector(a, past - a) * (weight * segment.length)
    share = dr.fmin(dr.fmax(0.5 - past / (2 * tilt), 0), 1)
    change = vector(share, 1 - share) * (-segment.length * counts * weight / slope)
    return Crossing(
        found=found,
        along=along,
        moved=dr.select(found, moved, 0),
        change=dr.select(found, change, 0),
        weight=weight,
        behind=dr.select(grazes, other < on, slope > 0),
        singular=(rooted | grazes) & (weight > SLIGHT) & (reach >= 2 * limits.faint),
        jump=dr.select(found, color[0] - color[1], 0),
        label_before=label[0],
        label_behind=label[1],
        more_before=valid & differ(label[0], segment.label_start) & (along - segment.start > 2 * gap),
        more_behind=valid & differ(label[1], segment.label_stop) & (segment.stop - along > 2 * gap),
        gap=gap,
        edge=edge,
    )


def _both_sides(
    scene: Scene, ray_at: Callable[[Array], Ray], path: Path, kind: type, limits: Limits, valid: Array
) -> tuple[tuple, tuple]:
    """What two rays, numbers 0 and 1, show of an edge at a path's node, if it is valid, and their labels, of a type."""

    def look(k, colors, labels):
        color, label = contrasted(scene, ray_at(k), path, limits)
        colors = dr.select(k == 0, color, colors[0]), dr.select(k == 0, colors[1], color)
        labels = dr.select(k == 0, label, labels[0]), dr.select(k == 0, labels[1], label)
        return k + 1, colors, labels

    width = dr.width(ray_at(ad.Int(0)))
    color: Any = dr.zeros(type(scene.background), width)
    label: Any = dr.zeros(kind, width)
    state: Any = dr.zeros(ad.Int, width), (color, color + 0), (label, label + 0)
    return dr.while_loop(state, lambda k, *_: valid & (k < 2), look, mode="symbolic", label="sides")[1:]


def _locate(scene: Scene, camera: View, size: Array, segment: Segment, limits: Limits) -> tuple[Array, Edge, Array]:
    """Find an edge in a segment, at the node of the largest weight that has one.

    Where none is found, for example because a second edge hides it, the event is `NOTHING`.

    Returns:
        Its distance from a, what it is, and the weight of its node.
    """

    def ray_at(along: Array) -> Ray:
        return image_ray(camera, size, *segment.at(along))

    start, stop = segment.start, segment.stop
    path, a, b, found = strongest_difference(scene, ray_at(start), ray_at(stop), limits)
    low, high, a, b = _bisect(scene, ray_at, path, start, stop, a, b, limits)
    event = classify(scene, a, b, path.bounces + 1, limits)

    def value(arrival: Arrival) -> Array:
        level, faint = level_function(scene, arrival, event, limits)
        return level + faint * arrival.weight

    # Of an edge at a sample itself rounding decides on which side that is, and on the level's sign
    ends: list[Any] = [value(a), value(b)]
    largest = dr.fmax(dr.abs(ends[0]), dr.abs(ends[1]))
    rounded = ends[0] * ends[1] > 0
    ends = [dr.select(rounded & (dr.abs(end) < ON_SAMPLE * largest), 0, end) for end in ends]
    crosses = found & (event.kind != NOTHING) & (ends[0] * ends[1] <= 0) & (largest > 0)
    along = _root(lambda along: value(follow(scene, ray_at(along), path, limits)), low, high, ends[0], ends[1], crosses)
    event.kind = dr.select(crosses & (along >= start) & (along <= stop), event.kind, NOTHING)
    edge = Edge(path, event)

    return along, edge, heavier(a.weight, b.weight)


def _slopes(
    scene: Scene, camera: View, size: Array, segment: Segment, along: Array, limits: Limits, edge: Edge
) -> tuple[Array, Array, Array, list[Array]]:
    """What an edge's level function does around the edge.

    Returns:
        Its slopes along the segment and across it, per pixel; how much of the edge's motion counts; and the cosines at which a
        crease's surfaces are met, in units of how far the ray turns from one sample to the next.
    """
    slopes = []
    for axis in range(2):
        at = dr.detach(segment.at(along))
        dr.enable_grad(at[axis])
        ray = image_ray(camera, size, *at)
        dr.set_grad(at[axis], 1)
        push_forward(at[axis])
        slopes.append((dr.grad(ray.o), dr.grad(ray.d)))
    moved, ray = level_jvp(scene, {}, dr.detach(ray), slopes, limits, edge)
    (right, *board_right, turn_right), (down, *board_down, turn_down) = moved
    turn = dr.norm(dr.select(segment.vertical, turn_down, turn_right)) * segment.length
    cosines = [cosine / turn for cosine in crease_cosines(scene, ray, edge.event)]
    counts = type(along)(1)
    if checkers(scene):
        cells = [dr.abs(slope) * segment.length for slope in (*board_right, *board_down)]
        most = dr.fmax(dr.fmax(*cells[:2]), dr.fmax(*cells[2:]))
        away = place(scene, ray, edge.event)[2]
        counts = dr.select(edge.event.kind == CELL, 1 - _smooth_step(FINE, CELLS, most) * _smooth_step(FAR / 2, FAR, away), 1)
    vertical = segment.vertical
    return dr.select(vertical, down, right), dr.select(vertical, right, down), counts, cosines


def _smooth_step(low: float, high: float, x: Array) -> Array:
    """0 up to low, 1 from high on, smooth in between."""
    t = dr.fmin(dr.fmax((x - low) / (high - low), 0), 1)
    return t * t * (3 - 2 * t)


def _bisect(
    scene: Scene, ray_at: Callable[[Array], Ray], path: Path, low: Array, high: Array, a: Arrival, b: Arrival, limits: Limits
) -> tuple:
    """Close in on the first flip of the node's decisions: a smaller segment, and the arrivals at its ends."""

    def decided(arrival: Arrival) -> Decisions:
        at = surface(scene, arrival.ray, closest_hit(scene, arrival.ray))
        branches = children(scene, arrival.ray, at, arrival.weight, path.bounces + 1, limits)
        return decide(scene, arrival.ray, at, [branch.active for branch in branches])

    own = decided(a)

    def halve(i, low, high, a, b):
        middle = (low + high) / 2
        there = follow(scene, ray_at(middle), path, limits)
        same = ~flips(own, decided(there))
        low, high = dr.select(same, middle, low), dr.select(same, high, middle)
        return i + 1, low, high, dr.select(same, there, a), dr.select(same, b, there)

    state = dr.zeros(type(a.ray.source), dr.width(a.weight)), low, high, a, b
    return dr.while_loop(state, lambda i, *_: i < HALVINGS, halve, mode="symbolic", label="bisect")[1:]


def _root(function: Callable[[Array], Array], a: Array, b: Array, at_a: Array, at_b: Array, active: Array) -> Array:
    """The root of a function between a and b, if active, by the Pegasus method (M. Dowell, P. Jarratt, BIT 12, 1972)."""
    near = (b - a) * (2.0**-9 if type(a) is ad.Float else 2.0**-23)

    def step(i, a, b, at_a, at_b, active):
        c = b - at_b * (b - a) / dr.select(at_b == at_a, 1, at_b - at_a)
        at_c = function(c)
        passed = at_c * at_b < 0
        total = at_b + at_c
        kept = at_a * at_b / dr.select(total == 0, 1, total)
        active = (dr.abs(c - b) > near) & (i < STEPS)
        return i + 1, dr.select(passed, b, a), c, dr.select(passed, at_b, kept), at_c, active

    width = dr.width(a)
    state = dr.zeros(ad.UInt32, width), a, b, at_a, at_b, active & dr.ones(ad.Bool, width)
    return dr.while_loop(state, lambda *state: state[-1], step, mode="symbolic", label="root")[2]
