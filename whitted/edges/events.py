"""The events that make edges, and the level function of each: zero on the edge, smooth across it.

| event | level function, of the ray that arrives at the node |
|---|---|
| outline of a shape | the shape's `outline`: for a sphere the discriminant of the ray |
| crease, where two surfaces cross | the one shape's `level` where the ray meets the other |
| shadow edge | the `outline` of the shape that blocks the light, of the line to the light |
| terminator of a specular surface | n . l |
| edge of a checkerboard's cell | distance of the point from it |
| onset of total internal reflection | cos_theta_t^2 |
| a child becomes too faint to be traced | its weight less the least importance |
"""

import math
from dataclasses import dataclass, replace

import drjit as dr

from ..core.arrays import Array, select
from ..core.ray import NONE, Ray
from ..scene.features import bends
from ..scene.scene import Scene
from ..scene.texture import coordinates
from ..shapes.sets import Hit, pick
from ..tracing.node import Limits, Node, Visit
from ..tracing.record import Hits
from ..tracing.scatter import scatter
from ..tracing.shadow import incident, shadowing
from ..tracing.surface import Surface, boards, surface
from .labels import Decisions, cos_theta_t_squared, decide
from .settings import CELLS


class Kind:
    """What happens at an edge."""

    NOTHING, OUTLINE, CREASE, SHADOW, TERMINATOR, CELL, TOTAL, TOO_FAINT = range(8)


@dataclass
class Event:
    """What happens at an edge, and to what (not frozen: Dr.Jit's loops write to their state)."""

    kind: Array  # UInt32, a `Kind`
    on: Array  # UInt32: the primitive that the ray meets there
    inside: Array  # Bool: from within
    # UInt32: the primitive that ends, crosses or casts a shadow; for a cell the board's axis, for a
    # faint child its number
    other: Array
    light: Array  # UInt32
    border: Array  # the number of the cell that begins at the edge

    def set(self, where: Array, kind: int, **fields: Array) -> None:
        """Change the event in some lanes."""
        self.kind = dr.select(where, kind, self.kind)
        for name, value in fields.items():
            setattr(self, name, dr.select(where, value, getattr(self, name)))

    def hit(self, scene: Scene, ray: Ray) -> Hit:
        """Where a ray meets the primitive of the event, or just misses it."""
        return reached(scene, ray, self.on, self.inside)


def reached(scene: Scene, ray: Ray, index: Array, inside: Array) -> Hit:
    """Where a ray meets a primitive, or just misses it."""
    shape, on = pick(scene.sets, index, scene.background), ray.source == index
    t = shape.of(lambda x: x.reach(ray, on, inside))
    return Hit(dr.detach(t), index, inside)


def reaching(scene: Scene, beside: Hits | None) -> Hits | None:
    """What finds the hits of rays that meet the same primitives as rays beside them."""
    if beside is None:
        return None

    def hit(node: Node) -> Hit:
        other = beside(node)
        return reached(scene, node.ray, other.index, other.inside)

    return hit


def _meets(scene: Scene, ray: Ray, index: Array) -> Array:
    """Bool: a ray meets a primitive, whatever lies in front of it."""
    on = ray.source == index

    def meets(shape):
        t, hits, _ = shape.distance(ray, on)
        return hits & (t < dr.inf)

    return (index != NONE) & pick(scene.sets, index, scene.background).of(meets)


def classify(scene: Scene, left: Visit, right: Visit) -> Event:
    """The event between two rays that arrive at one node, and there decide differently."""
    a, b = left.node, right.node
    here, there = decide(scene, left, all_sides=True), decide(scene, right, all_sides=True)
    uint, real = type(here.index), type(a.weight)
    event = Event(uint(Kind.NOTHING), here.index, here.inside, uint(NONE), uint(0), real(0))

    # From the faintest event of a node to the strongest: each overrides those before it
    for k, (x, y) in enumerate(zip(here.children, there.children, strict=True)):
        event.set(x != y, Kind.TOO_FAINT, other=uint(k))
    for x, y in zip(here.total, there.total, strict=True):
        event.set(x != y, Kind.TOTAL)
    for axis, (x, y) in enumerate(zip(here.cell, there.cell, strict=True)):
        # The middle one of several borders, so that few rounds of the search find them all
        near = (x != y) & (dr.abs(x - y) <= CELLS)
        event.set(near, Kind.CELL, other=uint(axis), border=real((x + y + 1) >> 1))
    for k in reversed(range(len(scene.lights))):
        _classify_light(scene, event, k, here, there, left.at, right.at)
    _classify_hit(scene, event, a.ray, b.ray, here, there)
    return event


def _classify_hit(
    scene: Scene, event: Event, a: Ray, b: Ray, here: Decisions, there: Decisions
) -> None:
    """Two surfaces cross where each goes on behind the other; else one of them ends."""
    others = here.index != there.index
    changes = others | (here.inside != there.inside)
    stays, hidden = _meets(scene, b, here.index), _meets(scene, a, there.index)
    ends = dr.select(stays | (here.index == NONE), there.index, here.index)
    event.set(changes, Kind.OUTLINE, other=ends)
    event.set(changes & stays & hidden & others, Kind.CREASE, other=there.index)


def _classify_light(
    scene: Scene, event: Event, k: int, here: Decisions, there: Decisions, at: Surface, to: Surface
) -> None:
    """A light reaches one side only: the terminator is in between, or the end of a shadow."""
    uint = type(event.kind)
    changes = here.lights[k] != there.lights[k]
    one, two = (incident(scene, each, k, all_sides=True) for each in (at, to))
    shadow_ends = changes & (one.dark != two.dark)
    if at.hit.shadows is not None:
        # What is in between was not looked for on a side that is turned away
        shadow_ends &= (one.cosine > 0) & (two.cosine > 0)
    if here.veils:
        dims = here.veils[k] != there.veils[k]
        changes, shadow_ends = changes | dims, shadow_ends | dims
    event.set(changes, Kind.TERMINATOR, light=uint(k))
    best = uint(NONE), type(event.border)(-math.inf)
    rays = (replace(each.ray, wanted=each.ray.wanted & shadow_ends) for each in (one, two))
    a, b = rays
    for primitives in scene.sets:
        best = primitives.flipped(a, b, shadowing(scene, "full", "part"), best)
    event.set(shadow_ends, Kind.SHADOW, other=best[0])


def level_function(scene: Scene, node: Node, event: Event, limits: Limits) -> tuple[Array, Array]:
    """The level function of an event at a node.

    Returns:
        The level function, and a part of it that is still to be multiplied with the node's weight
        and added: the weight of a child that is too faint.
    """
    ray, real = node.ray, type(node.weight)
    other = pick(scene.sets, event.other, scene.background)
    at = surface(scene, ray, event.hit(scene, ray))
    outline, crease = other.of(lambda x: x.outline(ray.o, ray.d)), other.of(lambda x: x.level(at.p))
    value = dr.select(event.kind == Kind.OUTLINE, outline, crease)
    if scene.lights:
        ways = ((k, light.way(at.p)) for k, light in enumerate(scene.lights))
        to_light = dr.normalize(select(event.light, ways, type(at.p)(0, 1, 0)))
        shadow = other.of(lambda x: x.outline(at.p, to_light))
        value = dr.select(event.kind == Kind.SHADOW, shadow, value)
        value = dr.select(event.kind == Kind.TERMINATOR, dr.dot(at.n, to_light), value)
    for material, board in boards(scene).items():
        border = board.level(at.p, dr.detach(at.n), event.other, event.border)
        value = dr.select((event.kind == Kind.CELL) & at.of[material], border, value)
    if bends(scene):
        value = dr.select(event.kind == Kind.TOTAL, cos_theta_t_squared(scene, ray, at)[0], value)
    faint = real(0)
    if limits.importance is not None:
        weights = ((k, branch.weight) for k, branch in enumerate(scatter(scene, ray, at)))
        faint = select(event.other, weights, faint)
        faint = faint * dr.sign(dr.detach(faint * node.weight))
        faint = dr.select(event.kind == Kind.TOO_FAINT, faint, 0)
        value = dr.select(event.kind == Kind.TOO_FAINT, -limits.importance, value)
    return value, faint


def board_place(scene: Scene, ray: Ray, event: Event) -> tuple[Array, Array, Array]:
    """Where a ray meets the checkerboard of an event.

    Returns:
        Column, row, and the distance along the ray in cells; 0 where there is no checkerboard.
    """
    hit = event.hit(scene, ray)
    at = surface(scene, ray, hit)
    column = row = away = type(hit.t)(0)
    for material, board in boards(scene).items():
        here, size = at.of[material], dr.detach(board.size)
        u, v = coordinates(at.p, dr.detach(at.n))
        column, row = dr.select(here, u / size, column), dr.select(here, v / size, row)
        away = dr.select(here, hit.t / size, away)
    return column, row, away


def crease(scene: Scene, ray: Ray, event: Event) -> tuple[Array, Array, Array]:
    """How a ray meets the surfaces `on` and `other` of a crease.

    Returns:
        The cosines at which it meets them, and the sine of the angle between them; elsewhere
        infinite.
    """
    p = ray.o + event.hit(scene, ray).t * ray.d

    def normal(index: Array) -> Array:
        outward = pick(scene.sets, index, scene.background).of(lambda x: x.implicit(p)[1])
        return dr.normalize(outward)

    on, other = normal(event.on), normal(event.other)
    met = dr.abs(dr.dot(on, ray.d)), dr.abs(dr.dot(other, ray.d)), dr.norm(dr.cross(on, other))
    is_crease = event.kind == Kind.CREASE
    return tuple(dr.select(is_crease, number, dr.inf) for number in met)


def has_rooted_outline(scene: Scene, event: Event) -> Array:
    """Bool: radiance beside the edge changes like the square root of the distance."""
    shape = pick(scene.sets, event.other, scene.background)
    outline = (event.kind == Kind.OUTLINE) & shape.whether(lambda kind: kind.rooted)
    return outline | (event.kind == Kind.TOTAL)
