"""Where an edge crosses the segment between two samples, and how it divides their cells."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
from drjit.llvm import ad

from ..autodiff.propagate import push_forward
from ..core.arrays import Array, precision_of
from ..core.numerics import smooth_step
from ..core.ray import Ray
from ..scene.scene import Scene
from ..tracing.node import Limits, Node, visit
from ..tracing.primary import CameraFrame, image_ray
from ..tracing.surface import boards
from .events import Kind, board_place, classify, crease_cosines, has_rooted_outline, level_function
from .labels import decide, decisions_differ, labels_differ
from .motion import Edge, level_jvp
from .paths import Path, contrasted, follow, strongest_difference
from .settings import (
    CELLS,
    FAR_CELLS,
    FULL_MOTION_CELLS,
    GAP,
    GAP_ULPS,
    GRAZING,
    LEAST_TILT,
    ON_SAMPLE,
    ROOT_STEPS,
    ROOT_TOLERANCE,
    SLIGHT,
)


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
        right, down = dr.select(self.vertical, 0, along), dr.select(self.vertical, along, 0)
        return self.x + right, self.y + down


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


@dataclass(frozen=True)
class Shot:
    """A scene as the camera of an image of some size sees it."""

    scene: Scene
    frame: CameraFrame
    size: Array
    limits: Limits

    def ray(self, segment: Segment, along: Array) -> Ray:
        """The ray through a place on a segment."""
        return image_ray(self.frame, self.size, *segment.at(along))


@dataclass(frozen=True)
class _Slopes:
    """What an edge's level function does around the edge."""

    along: Array  # its slope along the segment, per pixel
    across: Array  # and across it
    counts: Array  # how much of the edge's motion counts
    # The cosines at which the surfaces of a crease are met, in units of the angle that the ray
    # turns by from one sample to the next
    cosines: tuple[Array, Array]


def cross(shot: Shot, segment: Segment) -> Crossing:
    """Find an edge in a segment, and look at both its sides."""
    along, edge, reach = _locate(shot, segment)
    slopes = _slopes(shot, segment, along, edge)
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
    weight, moved, change = _areas(segment, along, slopes, valid)
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


def _areas(
    segment: Segment, along: Array, slopes: _Slopes, valid: Array
) -> tuple[Array, tuple[Array, Array], tuple[Array, Array]]:
    """The share of the edge, and the areas that it moves between the cells of a and b.

    The segment's line stands for a strip as wide as the segment is long. In it the edge is
    straight.

    Returns:
        The share, the areas, and the areas for a unit of growth of the level function.
    """
    slope, across, length = slopes.along, slopes.across, segment.length
    # Scaled, since fourth powers would leave the range of single precision
    largest = dr.fmax(dr.abs(slope), dr.abs(across))
    u, v = dr.square(slope / largest), dr.square(across / largest)
    weight = dr.select(valid, u * u / dr.fma(u, u, v * v), 0)
    # Half of how far the edge shifts along the pair, from one line of samples to the next
    tilt = length / 2 * dr.fmin(dr.fmax(dr.abs(across / slope), LEAST_TILT), 1)
    past = along - length / 2
    within = -(tilt - past) * (tilt - past) / (4 * tilt)
    a = dr.select(dr.abs(past) < tilt, within, dr.fmin(past, 0))
    moved = a * (weight * length), (past - a) * (weight * length)
    share = dr.fmin(dr.fmax(0.5 - past / (2 * tilt), 0), 1)
    growth = -length * slopes.counts * weight / slope
    return weight, moved, (share * growth, (1 - share) * growth)


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
    flip = strongest_difference(scene, *rays, limits)
    path = flip.path
    low, high, a, b = _halve(shot, segment, path, flip.a, flip.b)
    event = classify(scene, a, b, limits)

    def value(node: Node) -> Array:
        level, faint = level_function(scene, node, event, limits)
        return level + faint * node.weight

    # Where an edge is right at a sample, rounding decides which side that is on, and the level's
    # sign
    ends: list[Any] = [value(a), value(b)]
    largest = dr.fmax(dr.abs(ends[0]), dr.abs(ends[1]))
    rounded = ends[0] * ends[1] > 0
    ends = [dr.select(rounded & (dr.abs(end) < ON_SAMPLE * largest), 0, end) for end in ends]
    changes_sign = (ends[0] * ends[1] <= 0) & (largest > 0)
    crosses = (flip.weight > 0) & (event.kind != Kind.NOTHING) & changes_sign

    def level_at(along: Array) -> Array:
        return value(follow(scene, shot.ray(segment, along), path, limits))

    along = _root(level_at, low, high, ends[0], ends[1], crosses)
    there = crosses & (along >= segment.start) & (along <= segment.stop)
    event.kind = dr.select(there, event.kind, Kind.NOTHING)
    return along, Edge(path, event), dr.fmax(dr.abs(a.weight), dr.abs(b.weight))


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


def _slopes(shot: Shot, segment: Segment, along: Array, edge: Edge) -> _Slopes:
    """The slopes of an edge's level function, by moving the image position."""
    directions = []
    for axis in range(2):
        at = dr.detach(segment.at(along))
        dr.enable_grad(at[axis])
        ray = image_ray(shot.frame, shot.size, *at)
        dr.set_grad(at[axis], 1)
        push_forward(at[axis])
        directions.append((dr.grad(ray.o), dr.grad(ray.d)))
    still, limits = dr.detach(ray), shot.limits
    (right, down), arriving = level_jvp(shot.scene, {}, still, directions, limits, edge)
    vertical, length = segment.vertical, segment.length
    turn = dr.norm(dr.select(vertical, down.turn, right.turn)) * length
    on, other = crease_cosines(shot.scene, arriving, edge.event)
    counts = type(along)(1)
    if boards(shot.scene):
        across = dr.fmax(dr.abs(right.column), dr.abs(right.row))
        most = dr.fmax(across, dr.fmax(dr.abs(down.column), dr.abs(down.row))) * length
        away = board_place(shot.scene, arriving, edge.event)[2]
        small = smooth_step(FULL_MOTION_CELLS, CELLS, most)
        small *= smooth_step(FAR_CELLS / 2, FAR_CELLS, away)
        counts = dr.select(edge.event.kind == Kind.CELL, 1 - small, 1)
    return _Slopes(
        along=dr.select(vertical, down.level, right.level),
        across=dr.select(vertical, right.level, down.level),
        counts=counts,
        cosines=(on / turn, other / turn),
    )


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
