"""One chain of rays in the tree: from the camera to the node where an edge has its cause.

An edge of the image is one decision that flips, at one node. One chain of reflections and
refractions leads to the node. So finding the edge, and how it moves, costs a chain and not a tree.
"""

from dataclasses import dataclass
from typing import Any

import drjit as dr

from ..core.arrays import Array
from ..core.ray import Ray
from ..scene.features import reflects
from ..scene.scene import Scene
from ..shapes.sets import Hit
from ..tracing.node import BELOW, ON, Limits, Node, Visit, visit
from ..tracing.record import Hits, hit_of
from ..tracing.recursion import walk
from ..tracing.scatter import Branch
from ..tracing.shading import emitted
from .labels import (
    decide,
    decisions_differ,
    first_label,
    heavy,
    joined,
    labelled_radiance,
    least_weights,
    with_node,
)

# A path remembers the choice between reflection and refraction for this many bounces. After them
# it goes on with the reflected ray wherever a node sends both
REMEMBERED = 64


@dataclass
class Path:
    """The way to a node (not frozen: Dr.Jit's loops write to their state)."""

    bounces: Array  # UInt32: how many rays come before the node's own
    turns: Array  # UInt64: a bit for each bounce, 1 where it goes on with the refracted ray

    def refracts(self, bounce: Array) -> Array:
        """Bool: the path goes on with the refracted ray of a node that sends both."""
        return ((self.turns >> type(self.turns)(bounce)) & 1) != 0

    def onward(self, seen: Visit) -> tuple[Branch, Array]:
        """The child that the path goes on with, and Bool: it is the node's first child.

        Where only one child is active, it is that one; else the path's turns decide.
        """
        if len(seen.branches) == 1:
            return seen.branches[0], type(seen.branches[0].active)(True)
        a, b = seen.branches
        first = a.active & ~(b.active & self.refracts(seen.node.depth - 1))
        chosen = dr.select(first, a, b)
        chosen.active = a.active | b.active
        return chosen, first


def follow(scene: Scene, ray: Ray, path: Path, limits: Limits) -> Node:
    """Trace one chain down to its node."""
    node = Node.first(scene, ray)
    if not reflects(scene):
        return node

    def step(node, active):
        seen = visit(scene, node, limits)
        branch, _ = path.onward(seen)
        return seen.child(branch), branch.active & (node.depth < path.bounces)

    state = node, path.bounces > 0
    return dr.while_loop(state, lambda *s: s[-1], step, mode="symbolic", label="follow")[0]


def contrasted(scene: Scene, ray: Ray, path: Path, limits: Limits) -> tuple[Array, Array]:
    """Radiance that may change where the decisions of a path's node flip, and labels.

    Chains that are too faint for an edge are left out, unless they pass that node: their light is
    the same on both sides of the edge.
    """
    if not reflects(scene):
        return labelled_radiance(scene, ray, limits)
    least = least_weights(scene, limits)[-1]

    def step(node, state):
        light, label = state
        seen = visit(scene, node, limits)
        label = with_node(scene, seen, label, limits)
        light = dr.fma(node.weight, emitted(scene, node.ray, seen.at), light)
        on = node.link.has(ON)
        below = node.link.has(BELOW) | (on & (node.depth > path.bounces))
        _, first = path.onward(seen)
        children, onward = [], []
        for branch, taken in zip(seen.branches, (first, ~first), strict=False):
            child = seen.child(branch)
            child.link = child.link.marked(BELOW, below).marked(ON, ~below & on & taken)
            onward.append(branch.active & (below | (on & taken) | (dr.abs(child.weight) >= least)))
            children.append(child)
        return (light, label), children, onward

    width = dr.width(ray)
    root = Node.first(scene, ray)
    root.link = root.link.marked(ON, True)
    state = dr.zeros(type(ray.o), width), first_label(scene, limits, width)
    light, label = walk(scene, limits, root, state, step, "contrasted")
    return light, joined(label)


def bright_below(
    scene: Scene, root: Visit, limits: Limits, least: Array, hits: Hits | None
) -> Array:
    """Radiance of a node and of what is below it and weighs enough, times the weights.

    Args:
        hits: of the nodes below it, where they are known.
    """
    known = [root]

    def step(node, light):
        # The straight code of the root comes first, and only once
        seen = known.pop() if known else visit(scene, node, limits, hit_of(node, hits))
        light = dr.fma(seen.node.weight, emitted(scene, seen.node.ray, seen.at), light)
        return light, seen.children, heavy(seen, least)

    dark = dr.zeros(type(root.node.o), dr.width(root.node))
    return walk(scene, limits, root.node, dark, step, "bright_below", levels=1)


def partial_light(scene: Scene, ray: Ray, limits: Limits, least: Array, dim: Array) -> Array:
    """Radiance along rays that comes from some nodes.

    Args:
        dim: Bool: from those that weigh less than `least`; else from all others.
    """

    def step(node, light):
        seen = visit(scene, node, limits)
        weight = dr.select(dim & (dr.abs(node.weight) >= least), 0, node.weight)
        light = dr.fma(weight, emitted(scene, node.ray, seen.at), light)
        onward = zip(seen.traced, heavy(seen, least), strict=True)
        return light, seen.children, [dr.select(dim, every, some) for every, some in onward]

    dark = dr.zeros(type(ray.o), dr.width(ray))
    return walk(scene, limits, Node.first(scene, ray), dark, step, "partial_light")


@dataclass
class Pair:
    """Two nodes that two rays reach in the same way.

    Not frozen: Dr.Jit's loops write to their state.
    """

    a: Node
    o: Array  # of the other node, whose link is the same
    d: Array
    other_weight: Array
    turns: Array  # UInt64, of the path to the nodes

    @staticmethod
    def of(a: Node, b: Node, turns: Array) -> "Pair":
        return Pair(a, b.o, b.d, b.weight, turns)

    @property
    def b(self) -> Node:
        return Node(self.o, self.d, self.other_weight, self.a.link)

    @property
    def weight(self) -> Array:
        """The larger one of the two nodes' weights.

        Beside a silhouette the weight changes fast, and either ray may have the larger one.
        """
        return dr.fmax(dr.abs(self.a.weight), dr.abs(self.other_weight))

    @property
    def path(self) -> Path:
        return Path(self.a.depth - 1, self.turns)


@dataclass
class Flip:
    """Where two trees differ (not frozen: Dr.Jit's loops write to their state)."""

    pair: Pair
    hits: tuple[Hit, Hit]  # of the two rays


def strongest_difference(
    scene: Scene, a: Ray, b: Ray, limits: Limits, hits: tuple[Hits | None, Hits | None]
) -> Flip:
    """The node of the largest weight at which the trees of two rays decide differently.

    Both trees are walked at once.

    Args:
        hits: of the nodes of each ray, where they are known.

    Returns:
        The two rays that arrive at the node; their weight is 0 where there is no such node.
    """
    first, second = Node.first(scene, a), Node.first(scene, b)
    long: Any = dr.uint64_array_t(type(a.source))
    root = Pair.of(first, second, dr.zeros(long, dr.width(first)))

    def step(pair, best):
        left, right = (
            visit(scene, node, limits, hit_of(node, known))
            for node, known in zip((pair.a, pair.b), hits, strict=True)
        )
        differ = decisions_differ(decide(scene, left), decide(scene, right))
        differ &= pair.weight >= limits.faint
        here = Flip(pair, (left.at.hit, right.at.hit))
        best = dr.select(differ & (pair.weight > best.pair.weight), here, best)
        # All nodes below one weigh less than it does. So there is nothing to find below a node that
        # is too faint for an edge, or fainter than the best so far
        least = dr.fmax(limits.faint, best.pair.weight)
        children, onward = [], []
        for turn, (x, y) in enumerate(zip(left.branches, right.branches, strict=True)):
            bounce = dr.minimum(long(pair.a.depth - 1), REMEMBERED - 1)
            turns = pair.turns | (long(1) << bounce) if turn else pair.turns
            child = Pair.of(left.child(x), right.child(y), turns)
            onward.append(x.active & ~differ & (child.weight >= least))
            children.append(child)
        return best, children, onward

    zero = dr.zeros(type(first.weight), dr.width(first))
    nothing = Node(first.o + 0, first.d + 0, zero, first.link.copy())
    pair = Pair(nothing, second.o + 0, second.d + 0, zero + 0, root.turns + 0)
    none = Flip(pair, (Hit.none(zero, hits[0] is not None), Hit.none(zero, hits[1] is not None)))
    return walk(scene, limits, root, none, step, "strongest_difference")
