"""Where an edge crosses the segment between two neighbouring samples, and how steeply its level function falls there."""

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
from drjit.llvm import ad

from .camera import View, image_ray
from .chain import Arrival, Path, follow, strongest_difference
from .decisions import decide, mix
from .derivative import Edge, level_vjp, pull_back
from .events import NOTHING, classify, level_function
from .geometry import Array, Ray
from .scene import Scene, closest_hit
from .surface import surface
from .trace import Limits, children

# Halvings of a segment before its event is told from what lies at its ends, and most steps to the level function's root
HALVINGS = 3
STEPS = 20


@dataclass
class Segment:
    """From a sample to its right or lower neighbour (not frozen: Dr.Jit's loops write to their state)."""

    x: Array  # image position of the first sample, in pixels
    y: Array
    vertical: Array  # Bool: the other sample is below, not to the right
    length: Array  # in pixels

    def at(self, t: Array) -> tuple[Array, Array]:
        """The image position at a fraction of the way."""
        t = t * self.length
        return self.x + dr.select(self.vertical, 0, t), self.y + dr.select(self.vertical, t, 0)


@dataclass
class Crossing:
    t: Array  # where, as a fraction of the segment
    slope: Array  # of the level function along the segment, per pixel
    across: Array  # the same in the image's other direction
    edge: Edge


def locate(scene: Scene, camera: View, size: Array, segment: Segment, limits: Limits) -> Crossing:
    """Find an edge between two samples of different labels, at the node of the largest weight that has one.

    Where none is found, for example because a second edge hides it, the event is `NOTHING`.
    """

    def ray_at(t: Array) -> Ray:
        return image_ray(camera, size, *segment.at(t))

    zero = dr.zeros(type(segment.x), dr.width(segment.x))
    path, a, b, found = strongest_difference(scene, ray_at(zero), ray_at(zero + 1), limits)
    low, high, a, b = _bisect(scene, ray_at, path, a, b, limits)
    event = classify(scene, a, b, path.bounces + 1, limits)

    def value(arrival: Arrival) -> Array:
        level, faint = level_function(scene, arrival, event, limits)
        return level + faint * arrival.weight

    ends = value(a), value(b)
    t = _root(lambda t: value(follow(scene, ray_at(t), path, limits)), low, high, *ends)
    event.kind = dr.select(found & (ends[0] * ends[1] < 0) & (t >= 0) & (t <= 1), event.kind, NOTHING)
    edge = Edge(path, event)

    # The level function's slope in the image
    x, y = dr.detach(segment.at(t))
    dr.enable_grad(x, y)
    ray = image_ray(camera, size, x, y)
    _, o, d = level_vjp(scene, {}, {}, dr.detach(ray), zero + 1, limits, edge)
    pull_back(dr.dot(ray.o, o) + dr.dot(ray.d, d), dr.ones(type(t)))
    right, down = dr.grad(x), dr.grad(y)
    return Crossing(t, dr.select(segment.vertical, down, right), dr.select(segment.vertical, right, down), edge)


def _bisect(scene: Scene, ray_at: Callable[[Array], Ray], path: Path, a: Arrival, b: Arrival, limits: Limits) -> tuple:
    """Close in on the first flip of the node's decisions: a smaller segment, and the arrivals at its ends."""

    def label(arrival: Arrival) -> Array:
        at = surface(scene, arrival.ray, closest_hit(scene, arrival.ray))
        branches = children(scene, arrival.ray, at, arrival.weight, path.bounces + 1, limits)
        return mix(type(at.hit.index)(0), decide(scene, arrival.ray, at, [branch.active for branch in branches]))

    own = label(a)

    def halve(i, low, high, a, b):
        middle = (low + high) / 2
        there = follow(scene, ray_at(middle), path, limits)
        same = label(there) == own
        low, high = dr.select(same, middle, low), dr.select(same, high, middle)
        return i + 1, low, high, dr.select(same, there, a), dr.select(same, b, there)

    zero = dr.zeros(type(a.weight), dr.width(a.weight))
    state = dr.zeros(type(a.ray.source), dr.width(a.weight)), zero, zero + 1, a, b
    return dr.while_loop(state, lambda i, *_: i < HALVINGS, halve, mode="symbolic", label="bisect")[1:]


def _root(function: Callable[[Array], Array], a: Array, b: Array, at_a: Array, at_b: Array) -> Array:
    """The root of a function between a and b, by the Pegasus method (M. Dowell, P. Jarratt, BIT 12, 1972)."""
    near = 2.0**-12 if type(a) is ad.Float else 2.0**-26

    def step(i, a, b, at_a, at_b, active):
        c = b - at_b * (b - a) / dr.select(at_b == at_a, 1, at_b - at_a)
        at_c = function(c)
        passed = at_c * at_b < 0
        total = at_b + at_c
        kept = at_a * at_b / dr.select(total == 0, 1, total)
        active = (dr.abs(c - b) > near) & (i < STEPS)
        return i + 1, dr.select(passed, b, a), c, dr.select(passed, at_b, kept), at_c, active

    width = dr.width(a)
    state = dr.zeros(ad.UInt32, width), a, b, at_a, at_b, dr.ones(ad.Bool, width)
    return dr.while_loop(state, lambda *state: state[-1], step, mode="symbolic", label="root")[2]
