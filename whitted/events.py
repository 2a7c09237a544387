"""The events that make an edge, each with a level function that is zero on the edge and smooth across it.

| event | level function, of the ray that arrives at the node |
|---|---|
| silhouette of a sphere | discriminant of the ray with the sphere |
| horizon of a plane | n . d |
| crease, where two surfaces cross | the one surface's implicit function at the point where the ray meets the other |
| shadow edge | discriminant of the ray to the light with the sphere that blocks it |
| terminator of a specular surface | n . l |
| edge of a checkerboard's cell | distance of the point to it |
| onset of total internal reflection | cos_theta_t^2 |
| a child is too faint to be traced | its weight less the least importance |
"""

from dataclasses import dataclass

import drjit as dr

from .chain import Arrival
from .decisions import CELLS, Decisions, decide
from .geometry import NONE, Array, Plane, Ray, Sphere, chord, level, plane_distance, sphere_blocks, sphere_distance
from .optics import transmission
from .scene import Hit, Scene, closest_hit, starts_on
from .shading import incident
from .surface import Surface, checkers, on_plane, relative_index, surface
from .trace import Limits, children, refracts, scatter

NOTHING, SILHOUETTE, CREASE, SHADOW, TERMINATOR, CELL, TOTAL, FAINT = range(8)


@dataclass
class Event:
    """What happens at an edge (not frozen: Dr.Jit's loops write to their state)."""

    kind: Array  # UInt32
    on: Array  # UInt32: the primitive that the ray meets there
    inside: Array  # Bool: from within
    other: Array  # UInt32: the primitive that ends, crosses or casts a shadow; or light, cell coordinate, child
    light: Array  # UInt32
    border: Array  # the edge's coordinate on a checkerboard


def _chosen(scene: Scene, index: Array) -> tuple[Sphere, Plane, Array]:
    """The sphere or the plane of this index, and whether it is a sphere."""
    color, real = type(scene.background), type(scene.camera.fov)
    center, radius, normal, offset = color(0), real(1), color(0, 1, 0), real(0)
    for k, sphere in enumerate(scene.spheres):
        center, radius = dr.select(index == k, sphere.center, center), dr.select(index == k, sphere.radius, radius)
    for k, plane in enumerate(scene.planes, len(scene.spheres)):
        normal, offset = dr.select(index == k, plane.normal, normal), dr.select(index == k, plane.offset, offset)
    wide = any(sphere.wide for sphere in scene.spheres)
    return Sphere("", "", center, radius, wide), Plane("", "", normal, offset), index < len(scene.spheres)


def _meets(scene: Scene, ray: Ray, index: Array) -> Array:
    """Whether a ray meets a primitive, whatever lies before it."""
    sphere, plane, is_sphere = _chosen(scene, index)
    on = ray.source == index
    distance = plane_distance(plane, ray)
    meets_plane = (distance > 0) & (distance < dr.inf) & ~on
    return (index != NONE) & dr.select(is_sphere, sphere_distance(sphere, ray, on)[1], meets_plane)


def _distance(scene: Scene, ray: Ray, index: Array, inside: Array) -> Array:
    """The distance to a primitive, also of a ray that just misses it."""
    sphere, plane, is_sphere = _chosen(scene, index)
    b, discriminant = chord(sphere, ray.o, ray.d)
    half = dr.sqrt(dr.select(discriminant > 0, discriminant, 0))
    t = dr.select(ray.source == index, 2 * b, dr.select(inside, b + half, b - half))
    return dr.select(is_sphere, t, plane_distance(plane, ray))


def classify(scene: Scene, a: Arrival, b: Arrival, depth: Array, limits: Limits) -> Event:
    """The event between two rays that arrive at one node, and there decide differently."""
    at, to = (surface(scene, x.ray, closest_hit(scene, x.ray)) for x in (a, b))
    left, right = children(scene, a.ray, at, a.weight, depth, limits), children(scene, b.ray, to, b.weight, depth, limits)
    here, there = decide(scene, a.ray, at, [x.active for x in left]), decide(scene, b.ray, to, [x.active for x in right])
    uint, real = type(here.index), type(a.weight)
    event = Event(uint(NOTHING), here.index, here.inside, uint(NONE), uint(0), real(0))

    # What comes last overrides what comes before: from the faintest event of a node to the strongest
    for k, (x, y) in enumerate(zip(here.children, there.children, strict=True)):
        _set(event, x != y, FAINT, other=uint(k))
    for x, y in zip(here.total, there.total, strict=True):
        _set(event, x != y, TOTAL)
    for k, (x, y) in reversed(list(enumerate(zip(here.lights, there.lights, strict=True)))):
        _classify_light(scene, event, x != y, k, at, to)
    for axis, (x, y) in enumerate(zip(here.cell, there.cell, strict=True)):
        size = real(0)
        for k, _, cell in checkers(scene):
            size = dr.select(here.index == k, real(cell), size)
        # Of several borders the middle one, so that few rounds of the search find them all
        _set(event, (x != y) & (dr.abs(x - y) <= CELLS), CELL, other=uint(axis), border=real((x + y + 1) >> 1) * size)
    _classify_hit(scene, event, a.ray, b.ray, here, there)
    return event


def _set(event: Event, where: Array, kind: int, **fields: Array) -> None:
    event.kind = dr.select(where, kind, event.kind)
    for name, value in fields.items():
        setattr(event, name, dr.select(where, value, getattr(event, name)))


def _classify_hit(scene: Scene, event: Event, a: Ray, b: Ray, here: Decisions, there: Decisions) -> None:
    """One surface ends where it hides the other or is hidden by it; where both go on, they cross."""
    changes = (here.index != there.index) | (here.inside != there.inside)
    stays, hidden = _meets(scene, b, here.index), _meets(scene, a, there.index)
    ends = dr.select(stays | (here.index == NONE), there.index, here.index)
    _set(event, changes, SILHOUETTE, other=ends)
    _set(event, changes & stays & hidden & (here.index != there.index), CREASE, other=there.index)


def _classify_light(scene: Scene, event: Event, changes: Array, k: int, at: Surface, to: Surface) -> None:
    light, uint = scene.lights[k], type(event.kind)
    here, there = incident(scene, at, light), incident(scene, to, light)
    _set(event, changes, TERMINATOR, light=uint(k))
    changes = changes & (here.blocked != there.blocked)
    p, dark = dr.select(here.blocked, at.p, to.p), dr.select(here.blocked, here, there)
    inside = dr.select(here.blocked, at.hit.inside, to.hit.inside)
    other, nearest = uint(NONE), type(light.position.x)(-dr.inf)
    distance = dr.sqrt(dark.squared_distance)
    for index, sphere in enumerate(scene.spheres):
        on = starts_on(scene, at.hit.index, index)
        blocks = sphere_blocks(sphere, p, light.position, dark.direction, distance, on, inside)
        # Of several spheres that block the light on the one side, that which is nearest to blocking it on the other too
        gap = chord(sphere, dr.select(here.blocked, to.p, at.p), dr.select(here.blocked, there.direction, here.direction))[1]
        better = blocks & (gap > nearest)
        other, nearest = dr.select(better, index, other), dr.select(better, gap, nearest)
    _set(event, changes, SHADOW, other=other)


def _cos_squared(scene: Scene, ray: Ray, at: Surface) -> Array:
    return transmission(dr.fmax(-dr.dot(at.n, ray.d), 0), relative_index(scene, at))[0]


def level_function(scene: Scene, arrival: Arrival, event: Event, limits: Limits) -> tuple[Array, Array]:
    """The level function of an event at a ray that arrives at its node.

    Returns:
        The level function, and what of it is still to be multiplied with the arrival's weight and added: the weight of
        the child that is too faint.
    """
    ray, real = arrival.ray, type(arrival.weight)
    sphere, plane, is_sphere = _chosen(scene, event.other)
    t = dr.detach(_distance(scene, ray, event.on, event.inside))
    at = surface(scene, ray, Hit(t, event.on, event.inside))
    silhouette = dr.select(is_sphere, chord(sphere, ray.o, ray.d)[1], dr.dot(plane.normal, ray.d))
    crease = dr.select(is_sphere, level(sphere, at.p), dr.dot(plane.normal, at.p) + plane.offset)
    value = dr.select(event.kind == SILHOUETTE, silhouette, crease)
    if scene.lights:
        position = type(at.p)(0)
        for k, light in enumerate(scene.lights):
            position = dr.select(event.light == k, light.position, position)
        to_light = dr.normalize(position - at.p)
        value = dr.select(event.kind == SHADOW, chord(sphere, at.p, to_light)[1], value)
        value = dr.select(event.kind == TERMINATOR, dr.dot(at.n, to_light), value)
    for k, board, _ in checkers(scene):
        u, v = on_plane(at.p, dr.detach(board.normal))
        edge = dr.select(event.other == 0, u, v) - event.border
        value = dr.select((event.kind == CELL) & (event.on == k), edge, value)
    if refracts(scene):
        value = dr.select(event.kind == TOTAL, _cos_squared(scene, ray, at), value)
    faint = real(0)
    if limits.importance is not None:
        for k, branch in enumerate(scatter(scene, ray, at)):
            faint = dr.select(event.other == k, branch.weight, faint)
        faint = dr.select(event.kind == FAINT, faint * dr.sign(dr.detach(faint * arrival.weight)), 0)
        value = dr.select(event.kind == FAINT, -limits.importance, value)
    return value, faint


def place(scene: Scene, ray: Ray, event: Event) -> tuple[Array, Array, Array]:
    """Column and row of an event's checkerboard where a ray meets it, and its distance, all in cells; 0 where there is none."""
    t = dr.detach(_distance(scene, ray, event.on, event.inside))
    p = surface(scene, ray, Hit(t, event.on, event.inside)).p
    column = row = away = type(t)(0)
    for k, board, size in checkers(scene):
        here, (u, v) = event.on == k, on_plane(p, dr.detach(board.normal))
        column, row, away = (dr.select(here, new / size, old) for new, old in ((u, column), (v, row), (t, away)))
    return column, row, away


def crease_cosines(scene: Scene, ray: Ray, event: Event) -> tuple[Array, Array]:
    """The cosines of the angles at which a ray meets the two surfaces of a crease, `on` and `other`; infinite at other events."""
    t = dr.detach(_distance(scene, ray, event.on, event.inside))
    p = ray.o + t * ray.d

    def cosine(index: Array) -> Array:
        sphere, plane, is_sphere = _chosen(scene, index)
        n = dr.select(is_sphere, (p - sphere.center) / sphere.radius, plane.normal)
        return dr.select(event.kind == CREASE, dr.abs(dr.dot(n, ray.d)), dr.inf)

    return cosine(event.on), cosine(event.other)
