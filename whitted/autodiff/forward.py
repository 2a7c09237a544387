"""Forward mode: each ray carries its tangents down the tree of rays, one for each direction.

A node is a small function of its ray and the scene, and a tree of nodes is the chain rule. No
intermediate image is stored, whatever the depth. Several directions share the search for hits and
all else that does not depend on the direction; Dr.Jit computes equal expressions once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr

from ..core.arrays import Array, Parameters
from ..core.ray import Ray
from ..scene.scene import Scene
from ..shapes.sets import Hit
from ..tracing.intersect import closest_hit
from ..tracing.node import Limits, Node, visit
from ..tracing.record import Hits
from ..tracing.recursion import walk
from ..tracing.shading import emitted
from ..tracing.surface import surface
from .changed import changed
from .propagate import push_forward


@dataclass(frozen=True)
class Direction:
    """A direction of parameter space, as walks in forward mode take it."""

    scene: Scene  # without gradients; spheres that a tree finds have their tangents of it
    tangents: Parameters  # by parameter name, of width 1; those of others are 0


# For each direction, the tangents of rays' origins and directions
RaySlopes = Sequence[tuple[Array, Array]]


@dataclass
class Tangent:
    """The tangents of a node (not frozen: Dr.Jit's loops write to their state)."""

    o: Array
    d: Array
    weight: Array

    @staticmethod
    def first(node: Node, o: Array, d: Array) -> "Tangent":
        """The tangents of a first node, from those of its rays' origins and directions."""
        nothing = dr.zeros(type(node.o), dr.width(node))
        return Tangent(o + nothing, d + nothing, dr.zeros(type(node.weight), dr.width(node)))

    @property
    def moves(self) -> Array:
        """Bool: the node changes."""
        return dr.any(self.o != 0) | dr.any(self.d != 0) | (self.weight != 0)

    @staticmethod
    def of(node: Node) -> "Tangent":
        """The tangents that forward mode has brought to a node."""
        return Tangent(dr.grad(node.o), dr.grad(node.d), dr.grad(node.weight))


@dataclass
class Moving:
    """A node and its tangents (not frozen: Dr.Jit's loops write to their state)."""

    node: Node
    ahead: tuple[Tangent, ...]


def attached(direction: Direction, node: Node, tangent: Tangent) -> tuple[object, Scene, Node]:
    """Inputs with fresh tangents, and the scene and the node that are made of them."""
    scene, tangents = direction.scene, direction.tangents
    values = scene.parameters(*tangents) if tangents else {}
    inputs = dr.detach((node.o, node.d, node.weight, values))
    dr.enable_grad(inputs)
    dr.set_grad(inputs, (tangent.o, tangent.d, tangent.weight, dict(tangents)))
    o, d, weight, values = inputs
    there, rows = scene.carrying(values), []
    if scene.gathered is not None:
        gathered = scene.gathered.anew()
        there, rows = there.gathering(gathered), gathered.rows
    return (inputs, rows), there, Node(o, d, weight, node.link)


def radiance_jvp(
    directions: Sequence[Direction],
    ray: Ray,
    slopes: RaySlopes,
    limits: Limits,
    hits: Hits | None = None,
) -> tuple[Array, ...]:
    """The derivatives of radiance along rays, in some directions of parameter space.

    Args:
        directions: of one scene, with unit vectors for its directions; at least one.
        slopes: of the rays, in each direction.
        hits: what the rays have met, if it is known.

    Returns:
        Array3f for each direction, the tangent of `recursion.radiance`.
    """
    scene = directions[0].scene
    these = changed(scene, [name for one in directions for name in one.tangents])
    first = Node.first(scene, ray)
    dark = tuple(dr.zeros(type(ray.o), dr.width(first)) for _ in directions)

    def light(dark, moving, hit):
        found = []
        for direction, tangent in zip(directions, moving.ahead, strict=True):
            inputs, there, node = attached(direction, moving.node, tangent)
            value = node.weight * emitted(there, node.ray, surface(there, node.ray, hit))
            push_forward(inputs)
            found.append(dr.grad(value))
        return tuple(found)

    def step(moving, result):
        node = moving.node
        hit = hits(node) if hits is not None else closest_hit(scene, node.ray)
        if these is None:
            found = light(dark, moving, hit)
        else:
            moves = these.among(scene, hit.index)
            for tangent in moving.ahead:
                moves |= tangent.moves
            found = dr.if_stmt((dark, moving, hit), moves, light, lambda dark, *_: dark)
        result = tuple(old + new for old, new in zip(result, found, strict=True))
        return result, *_children(directions, moving, limits, hit)

    root = Moving(first, tuple(Tangent.first(first, o, d) for o, d in slopes))
    active = None
    if these is not None and hits is None:
        # A packet that sees still walls alone skips the loop
        active = these.reached(scene, ray)
        for tangent in root.ahead:
            active |= tangent.moves
    return walk(scene, limits, root, dark, step, "radiance_jvp", active=active)


def _children(
    directions: Sequence[Direction], moving: Moving, limits: Limits, hit: Hit
) -> tuple[list[Moving], list[Array]]:
    """A node's children with their tangents, and for each of them whether to go on with it."""
    ahead: list[list[Tangent]] = []
    onward: list[Array] = []
    for direction, tangent in zip(directions, moving.ahead, strict=True):
        inputs, there, node = attached(direction, moving.node, tangent)
        seen = visit(there, node, limits, hit)
        children = seen.children
        push_forward(inputs)
        ahead.append([Tangent.of(child) for child in children])
        # A weight of 0 may be differentiated in one direction alone
        traced = dr.detach(seen.traced)
        onward = [a | b for a, b in zip(onward, traced, strict=True)] if onward else traced
    tangents = zip(*ahead, strict=True)
    return [Moving(dr.detach(n), t) for n, t in zip(children, tangents, strict=True)], onward
