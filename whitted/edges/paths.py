"""One chain of rays in the tree: the way from the camera to the node where an edge has its cause.

An edge of the image is one decision, at one node, that flips. The node is reached by one chain of
reflections and refractions, so that finding the edge and its motion costs a chain, and not the
tree.
"""

from dataclasses import dataclass

import drjit as dr

from ..core.arrays import Array
from ..core.ray import Ray
from ..scene.features import reflects
from ..scene.scene import Scene
from ..tracing.node import BELOW, ON, Limits, Link, Node, Visit, visit
from ..tracing.recursion import walk
from ..tracing.scatter import Branch
from ..tracing.shading import emitted
from .labels import (
    decide,
    decisions_differ,
    first_label,
    joined,
    labelled_radiance,
    least_weights,
    with_node,
)

# Bounces whose choice between reflection and refraction a path remembers; beyond, where a node has
# both children, it goes on with the reflected one
REMEMBERED = 64


@dataclass
class Path:
    """The way to a node (not frozen: Dr.Jit's loops write to their state)."""

    bounces: Array  # UInt32: how many rays come before the node's own
    turns: Array  # UInt64: a bit for each bounce, 1 where it goes on with the refracted ray

    def refracts(self, bounce: Array) -> Array:
        """Whether the path goes on with the refracted ray of a node that sends both."""
        return ((self.turns >> type(self.turns)(bounce)) & 1) != 0

    def onward(self, seen: Visit) -> tuple[Branch, Array]:
        """The child that the path goes on with, and whether it is the first: the only active one,
        or as it turns.
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
    node = Node.first(ray)
    if not reflects(scene):
        return node

    def step(node, active):
        seen = visit(scene, node, limits)
        branch, _ = path.onward(seen)
        return seen.child(branch), branch.active & (node.depth < path.bounces)

    state = node, path.bounces > 0
    return dr.while_loop(state, lambda *s: s[-1], step, mode="symbolic", label="follow")[0]


def contrasted(scene: Scene, ray: Ray, path: Path, limits: Limits) -> tuple[Array, Array]:
    """Radiance along rays, as far as it may change where the decisions of a path's node flip, and
    labels.

    What is too faint for an edge is left out unless the light of that node is in it: on both sides
    of the edge it is the same.
    """
    if not reflects(scene):
        return labelled_radiance(scene, ray, limits)
    least = least_weights(scene, limits)[-1]

    def step(node, state):
        light, label = state
        seen = visit(scene, node, limits)
        light = dr.fma(node.weight, emitted(scene, node.ray, seen.at), light)
        label = with_node(scene, seen, label, limits)
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
    root = Node.first(ray)
    root.link = Link(root.link.word | ON)
    state = dr.zeros(type(ray.o), width), first_label(scene, limits, width)
    light, label = walk(scene, limits, root, state, step, "contrasted")
    return light, joined(label)


@dataclass
class Pair:
    """Two nodes that two rays reach in the same way (not frozen: Dr.Jit's loops write to their
    state).
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
        """The larger one of two weights: between a silhouette and a sample it may be that of the
        one or the other.
        """
        return dr.fmax(dr.abs(self.a.weight), dr.abs(self.other_weight))

    @property
    def path(self) -> Path:
        return Path(self.a.depth - 1, self.turns)


def strongest_difference(scene: Scene, a: Ray, b: Ray, limits: Limits) -> Pair:
    """Walk the trees of two rays at once for the node of the largest weight at which they decide
    differently.

    Returns:
        The two rays that arrive at the node; their weight is 0 where there is no such node.
    """
    first, second = Node.first(a), Node.first(b)
    long = dr.uint64_array_t(type(a.source))
    root = Pair.of(first, second, dr.zeros(long, dr.width(first)))

    def step(pair, best):
        left, right = visit(scene, pair.a, limits), visit(scene, pair.b, limits)
        differ = decisions_differ(decide(scene, left), decide(scene, right)) & (
            pair.weight >= limits.faint
        )
        best = dr.select(differ & (pair.weight > best.weight), pair, best)
        # Below a node all weigh less: where that is too faint for an edge, or than the best so far,
        # none is of use
        least = dr.fmax(limits.faint, best.weight)
        children, onward = [], []
        for turn, (x, y) in enumerate(zip(left.branches, right.branches, strict=True)):
            bounce = dr.minimum(long(pair.a.depth - 1), REMEMBERED - 1)
            turns = pair.turns | (long(1) << bounce) if turn else pair.turns
            child = Pair.of(left.child(x), right.child(y), turns)
            onward.append(x.active & ~differ & (child.weight >= least))
            children.append(child)
        return best, children, onward

    zero = dr.zeros(type(first.weight), dr.width(first))
    nothing = Node(first.o + 0, first.d + 0, zero, Link(first.link.word + 0))
    none = Pair(nothing, second.o + 0, second.d + 0, zero + 0, root.turns + 0)
    return walk(scene, limits, root, none, step, "strongest_difference")
