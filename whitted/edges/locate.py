"""Where an edge crosses the segment between two samples, and how it divides their cells."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
from drjit.llvm import ad

from ..core.arrays import Array, precision_of
from ..tracing.node import Node, visit
from .events import Event, Kind, classify, has_rooted_outline, level_function
from .labels import decide, decisions_differ, labels_differ
from .motion import Edge
from .paths import Path, contrasted, follow, strongest_difference
from .settings import (
    FADING,
    GAP,
    GAP_ULPS,
    GRAZING,
    ON_SAMPLE,
    ROOT_STEPS,
    ROOT_TOLERANCE,
    SLIGHT,
)
from .slopes import Line, Shot, areas, slopes_of


@dataclass
class Segment(Line):
    """What is to be searched of a line between two samples."""

    start: Array
    stop: Array
    label_start: Array  # UInt32 or UInt64: the labels at start and stop
    label_stop: Array


@dataclass
class Crossing:
    """An edge between a and b, which moves multiples of its jump from one cell to the other."""

    found: Array  # Bool
    along: Array  # distance from a
    # Array2f: what the cells of a and b gain, since the edge is not midway and not at right angles
    moved: Array
    change: Array  # Array2f: what they gain as the level function grows
    # The share of the edge that pairs of this direction account for; pairs of the other have the
    # rest
    weight: Array
    # Bool: radiance near the edge changes like the root of the distance or faster, enough to matter
    singular: Array
    behind: Array  # Bool: it does so behind the edge, not before it
    before: Array  # Array3f: radiance right before the edge
    jump: Array  # Array3f: the same, less radiance right behind the edge
    label_before: Array  # UInt32 or UInt64: the labels there
    label_behind: Array
    more_before: Array  # Bool: another edge is between start and this one
    more_behind: Array
    gap: Array  # from the edge to right before and right behind, in pixels
    edge: Edge


def cross(shot: Shot, segment: Segment) -> Crossing:
    """Find an edge in a segment, and look at both its sides."""
    along, edge, reach = _locate(shot, segment)
    slopes = slopes_of(shot, segment, along, edge, FADING)
    finite = dr.isfinite(along) & dr.isfinite(slopes.along) & dr.isfinite(slopes.across)
    valid = (edge.event.kind != Kind.NOTHING) & finite & (slopes.along != 0)
    precision = precision_of(along)
    ulp = precision.epsilon * dr.fmax(shot.size.x, shot.size.y)
    gap = dr.fmax(segment.length * GAP[precision.name], GAP_ULPS * ulp)
    color, label = _both_sides(shot, segment, along, gap, edge.path, valid)
    found = valid & labels_differ(*label)

    left_before = labels_differ(label[0], segment.label_start)
    left_behind = labels_differ(label[1], segment.label_stop)
    on, other = slopes.cosines
    grazes = (on < GRAZING) | (other < GRAZING)
    rooted = has_rooted_outline(shot.scene, edge.event)
    weight, moved, change = areas(segment, along, slopes, valid)
    return Crossing(
        found=found,
        along=along,
        moved=dr.select(found, type(shot.size)(*moved), 0),
        change=dr.select(found, type(shot.size)(*change), 0),
        weight=weight,
        behind=dr.select(grazes, other < on, slopes.along > 0),
        singular=(rooted | grazes) & (weight > SLIGHT) & (reach >= 2 * shot.limits.faint),
        before=color[0],
        jump=dr.select(found, color[0] - color[1], 0),
        label_before=label[0],
        label_behind=label[1],
        more_before=valid & left_before & (along - segment.start > 2 * gap),
        more_behind=valid & left_behind & (segment.stop - along > 2 * gap),
        gap=gap,
        edge=edge,
    )


def _both_sides(
    shot: Shot, segment: Segment, along: Array, gap: Array, path: Path, valid: Array
) -> tuple[tuple, tuple]:
    """Radiance and labels right before an edge and right behind it, in valid lanes."""

    def look(k, colors, labels):
        ray = shot.ray(segment, along + dr.select(k == 0, -gap, gap))
        color, label = contrasted(shot.scene, ray, path, shot.limits)
        colors = dr.select(k == 0, color, colors[0]), dr.select(k == 0, colors[1], color)
        labels = dr.select(k == 0, label, labels[0]), dr.select(k == 0, labels[1], label)
        return k + 1, colors, labels

    width = dr.width(along)
    color: Any = dr.zeros(type(shot.scene.background), width)
    label: Any = dr.zeros(type(segment.label_start), width)
    state: Any = dr.zeros(ad.Int, width), (color, color + 0), (label, label + 0)

    def goes_on(k, *_):
        return valid & (k < 2)

    return dr.while_loop(state, goes_on, look, mode="symbolic", label="sides")[1:]


def _locate(shot: Shot, segment: Segment) -> tuple[Array, Edge, Array]:
    """Find an edge in a segment, at the node of the largest weight that has one.

    Where none is found, for example because a second edge hides it, the event is `NOTHING`.

    Returns:
        Its distance from a, what it is, and the weight of its node.
    """
    scene, limits = shot.scene, shot.limits
    rays = shot.ray(segment, segment.start), shot.ray(segment, segment.stop)
    flip = strongest_difference(scene, *rays, limits, (None, None)).pair
    path = flip.path
    low, high, a, b = _halve(shot, segment, path, flip.a, flip.b)
    event = classify(scene, visit(scene, a, limits), visit(scene, b, limits))

    ends, crosses = end_levels(shot, event, a, b)
    crosses &= flip.weight > 0

    def level_at(along: Array) -> Array:
        return level(shot, event, follow(scene, shot.ray(segment, along), path, limits))

    along = _root(level_at, low, high, ends[0], ends[1], crosses)
    there = crosses & (along >= segment.start) & (along <= segment.stop)
    event.kind = dr.select(there, event.kind, Kind.NOTHING)
    return along, Edge(path, event), dr.fmax(dr.abs(a.weight), dr.abs(b.weight))


def level(shot: Shot, event: Event, node: Node) -> Array:
    """An event's level function at a node."""
    value, faint = level_function(shot.scene, node, event, shot.limits)
    return value + faint * node.weight


def end_levels(shot: Shot, event: Event, a: Node, b: Node) -> tuple[list[Array], Array]:
    """An event's level function at two nodes, and Bool: it is zero in between.

    Where an edge is right at a sample, rounding decides which side that is on, and the level's
    sign.
    """
    ends: list[Any] = [level(shot, event, a), level(shot, event, b)]
    largest = dr.fmax(dr.abs(ends[0]), dr.abs(ends[1]))
    rounded = ends[0] * ends[1] > 0
    ends = [dr.select(rounded & (dr.abs(end) < ON_SAMPLE * largest), 0, end) for end in ends]
    changes_sign = (ends[0] * ends[1] <= 0) & (largest > 0)
    return ends, (event.kind != Kind.NOTHING) & changes_sign


def _halve(
    shot: Shot, segment: Segment, path: Path, a: Node, b: Node
) -> tuple[Array, Array, Node, Node]:
    """The half of a segment where the node's decisions first flip, and the nodes at its ends."""

    def decided(node: Node) -> Any:
        return decide(shot.scene, visit(shot.scene, node, shot.limits))

    low, high = segment.start, segment.stop
    middle = (low + high) / 2
    there = follow(shot.scene, shot.ray(segment, middle), path, shot.limits)
    same = ~decisions_differ(decided(a), decided(there))
    low, high = dr.select(same, middle, low), dr.select(same, high, middle)
    return low, high, dr.select(same, there, a), dr.select(same, b, there)


def _root(
    function: Callable[[Array], Array], a: Array, b: Array, at_a: Array, at_b: Array, active: Array
) -> Array:
    """The root of a function between a and b, in active lanes, by the Pegasus method.

    Source: M. Dowell, P. Jarratt, "The Pegasus Method for Computing the Root of an Equation", BIT
    12 (1972).
    """
    near = (b - a) * ROOT_TOLERANCE[precision_of(a).name]

    def step(i, a, b, at_a, at_b, active):
        c = b - at_b * (b - a) / dr.select(at_b == at_a, 1, at_b - at_a)
        at_c = function(c)
        passed = at_c * at_b < 0
        total = at_b + at_c
        kept = at_a * at_b / dr.select(total == 0, 1, total)
        active = (dr.abs(c - b) > near) & (i < ROOT_STEPS)
        return i + 1, dr.select(passed, b, a), c, dr.select(passed, at_b, kept), at_c, active

    width = dr.width(a)
    state = dr.zeros(ad.UInt32, width), a, b, at_a, at_b, active & dr.ones(ad.Bool, width)
    return dr.while_loop(state, lambda *s: s[-1], step, mode="symbolic", label="root")[2]
