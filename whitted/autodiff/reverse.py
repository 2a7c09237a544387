"""Reverse mode: a walk that returns up the tree of rays.

Dr.Jit cannot record a loop with a stack for reverse mode, and it need not. A node's own light is
differentiated when the walk arrives at it. Each child is differentiated when the walk comes back
from it, with the adjoints of its ray and the light that it saw. No intermediate image is stored,
whatever the depth.
"""

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr

from ..core.arrays import Array, Parameters
from ..core.ray import Ray
from ..core.stack import Stack
from ..scene.features import branches_out, reflects
from ..scene.scene import Scene
from ..shapes.sets import Hit
from ..tracing.intersect import closest_hit
from ..tracing.node import BOTH, FIRST, MOVES, Limits, Node, Visit, visit
from ..tracing.record import Hits
from ..tracing.scatter import Branch, scatter
from ..tracing.shading import emitted
from ..tracing.surface import surface
from .changed import Changed, changed
from .propagate import pull_back


@dataclass
class Adjoint:
    """What a traced ray returns to its parent (not frozen: Dr.Jit's loops write to their state)."""

    o: Array  # derivative by its origin
    d: Array  # and by its direction
    value: Array  # dot(seed, radiance), before the weight of its chain

    @staticmethod
    def zero(like: Node, width: int = 1) -> "Adjoint":
        return Adjoint(*(dr.zeros(type(x), width) for x in (like.o, like.d, like.weight)))

    def plus(self, other: "Adjoint") -> "Adjoint":
        return Adjoint(self.o + other.o, self.d + other.d, self.value + other.value)


def radiance_vjp(
    scene: Scene,
    sums: Parameters,
    wide: Parameters,
    ray: Ray,
    seed: Array,
    limits: Limits,
    moves: bool = True,
    hits: Hits | None = None,
) -> tuple[Parameters, Array, Array]:
    """The derivatives of dot(seed, radiance) along rays.

    Args:
        scene: with unit vectors for its directions, and no gradients.
        sums: parameter name to derivatives so far, as wide as the wavefront.
        wide: parameter name to value, as wide as the wavefront, which keeps each lane's derivative
            in its lane.
        seed: Array3f, the adjoint of `recursion.radiance`.
        moves: whether derivatives by the rays are of use.
        hits: what the rays have met, if it is known.

    Returns:
        The sums with these rays' derivatives added, and the derivatives by the rays' origins and
        directions.
    """
    these = None if moves else changed(scene, wide)
    return walk_back(Tree(scene, wide, seed, limits, these, hits), sums, ray)


@dataclass
class Place:
    """Where a walk in reverse mode is (not frozen: Dr.Jit's loops write to their state)."""

    node: Node
    back: Adjoint  # what the node has so far, or what it returns
    moves: Array  # Bool: something changes on the way to the node


@dataclass
class Waiting:
    """A node on the stack, to which the walk comes back (not frozen, like `Place`)."""

    node: Node  # its link holds the primitive that was hit, and marks that tell of its children
    back: Adjoint
    t: Array  # the distance of the hit


def walk_back(tree: "Tree", sums: Parameters, ray: Ray) -> tuple[Parameters, Array, Array]:
    """Walk down a tree of rays and back.

    Returns:
        The sums, and the derivatives by the rays' origins and directions.
    """
    scene, limits = tree.scene, tree.limits
    width = dr.width(ray)
    node = Node.first(scene, ray)
    mask = dr.mask_t(node.weight)
    place = Place(node, Adjoint.zero(node, width), dr.full(mask, tree.changed is None, width))
    stack = Stack.allocate(
        limits.capacity if reflects(scene) else 0,
        dr.zeros(type(limits.depth), width),
        Waiting(node, place.back, node.weight),
    )
    state: Any = place, stack, dict(sums)
    if not reflects(scene):
        place, _, sums, _ = tree.arrive(*state)
        return sums, place.back.o, place.back.d

    def stay(*state):
        return *state, dr.zeros(mask, width)

    def step(place, stack, sums, tracing):
        state = dr.if_stmt((place, stack, sums), tracing, tree.arrive, stay)
        returning = ~state[-1] & (state[1].size > 0)
        return dr.if_stmt(state, returning, tree.come_back, lambda *state: state)

    seeded = dr.any(tree.seed != 0) & dr.ones(mask, width)
    if tree.changed is not None and tree.hits is None:
        # A packet that sees still walls alone skips the loop
        seeded &= tree.changed.reached(scene, node.ray)
    state = *state, seeded
    state = dr.while_loop(
        state, lambda *s: s[-1] | (s[1].size > 0), step, mode="symbolic", label="radiance_vjp"
    )
    place, _, sums, _ = state
    return sums, place.back.o, place.back.d


@dataclass(frozen=True)
class Tree:
    """The two steps of a walk through a tree of rays in reverse mode.

    A ray moves if something changes on the way to it. Light is differentiated where a moving ray
    arrives, and at primitives that change. Other light does not change.
    """

    scene: Scene
    wide: Parameters
    seed: Array
    limits: Limits
    changed: Changed | None  # what changes; None if all does, or if the first ray moves
    hits: Hits | None  # what rays meet, if it is known

    def attached(self, node: Node) -> tuple[Scene, Node, dict[str, Array]]:
        """The scene, the node and the parameters, with fresh gradients."""
        values, o, d = dr.detach(dict(self.wide)), dr.detach(node.o), dr.detach(node.d)
        dr.enable_grad(values, o, d)
        scene = self.scene.carrying(values)
        if scene.gathered is not None:
            scene = scene.gathering(scene.gathered.anew())
        return scene, Node(o, d, node.weight, node.link), values

    def where(self, moves, differentiated, node, hit, sums, *more):
        """What a node adds to its ray's adjoint and to the sums; nothing where nothing moves."""
        inputs = node, hit, sums, *more
        if self.changed is None:
            return differentiated(*inputs)
        # Zeros that were created inside of the branch, Dr.Jit would reuse after it
        dark = Adjoint.zero(node)
        return dr.if_stmt(
            (dark, *inputs),
            moves,
            lambda dark, *inputs: differentiated(*inputs),
            lambda dark, node, hit, sums, *_: (dark, sums),
        )

    def light(self, node, hit, sums):
        """The light of a surface itself."""
        scene, there, values = self.attached(node)
        light = dr.dot(self.seed, emitted(scene, there.ray, surface(scene, there.ray, hit)))
        pull_back(light, node.weight)
        back = Adjoint(dr.grad(there.o), dr.grad(there.d), dr.detach(light))
        return back, added(sums, values, scene)

    def through(self, node, hit, sums, first, back):
        """The light of a child."""
        scene, there, values = self.attached(node)
        at = surface(scene, there.ray, hit)
        branches = scatter(scene, there.ray, at)
        child = choose(first, *branches) if len(branches) == 2 else branches[0]
        light = child.weight * (node.weight * back.value)
        output = dr.dot(at.p, back.o) + dr.dot(child.direction, back.d) + light
        pull_back(output, dr.ones(type(node.weight)))
        value = dr.detach(child.weight) * back.value
        return Adjoint(dr.grad(there.o), dr.grad(there.d), value), added(sums, values, scene)

    def arrive(self, place, stack, sums):
        """Trace a ray: differentiate the light of its surface, then go on with its first child."""
        node, moves = place.node, place.moves
        hit = self.hits(node) if self.hits is not None else closest_hit(self.scene, node.ray)
        if self.changed is not None:
            moves = moves | self.changed.among(self.scene, hit.index)
        scene, there, _ = self.attached(node)
        # Attached, as a weight of 0 that is differentiated has a child, too
        seen = visit(scene, there, self.limits, hit)
        back, sums = self.where(moves, self.light, node, hit, sums)
        if not seen.branches:
            return Place(node, back, moves), stack, sums, dr.zeros(type(moves), dr.width(node))
        branches = dr.detach(seen.branches)
        child, first, both = branches[0], branches[0].active, type(moves)(False)
        if len(branches) == 2:
            child, both = choose(first, *branches), first & branches[1].active
        link = node.link.of(hit.index, hit.inside, node.depth)
        link = link.marked(FIRST, first).marked(BOTH, both).marked(MOVES, moves)
        waiting = Waiting(Node(node.o, node.d, node.weight, link), back, hit.t)
        stack = stack.push(child.active, waiting)
        return Place(dr.detach(seen.child(child)), back, moves), stack, sums, child.active

    def come_back(self, place, stack, sums, tracing):
        """Take a child's adjoints through its parent.

        Then go on with the second child, or return further.
        """
        nothing = Waiting(place.node, place.back, place.node.weight)
        stack, waiting = stack.pop(type(tracing)(True), nothing)
        node, link = waiting.node, waiting.node.link
        first, both, moves = (link.has(mark) for mark in (FIRST, BOTH, MOVES))
        hit = Hit(waiting.t, link.source, link.inward)
        through, sums = self.where(moves, self.through, node, hit, sums, first, place.back)
        back = waiting.back.plus(through)
        if not branches_out(self.scene):
            return Place(node, back, moves), stack, sums, both
        scene, there, _ = self.attached(node)
        at = surface(scene, there.ray, hit)
        second = dr.detach(scatter(scene, there.ray, at)[1])
        link = link.of(hit.index, hit.inside, link.depth).marked(MOVES, moves)
        waiting = Waiting(Node(node.o, node.d, node.weight, link), back, hit.t)
        child = dr.detach(Visit(node, at, []).child(second))
        return Place(child, back, moves), stack.push(both, waiting), sums, both


def choose(condition: Array, a: Branch, b: Branch) -> Branch:
    """The first branch where the condition holds, else the second; active where one of them is."""
    return replace(dr.select(condition, a, b), active=a.active | b.active)


def added(sums: Parameters, values: Parameters, scene: Scene) -> dict[str, Array]:
    """The sums with the derivatives that reverse mode has brought to some values of a scene."""
    if scene.gathered is not None:
        scene.gathered.add()
    return {name: sums[name] + dr.grad(values[name]) for name in sums}
