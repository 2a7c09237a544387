"""Walks through the tree of boxes around many spheres, in kernels.

The nearest hit is looked for with a short stack, the nearer of two boxes first. All else follows
the links of `hierarchy.py` from node to node, without a stack.

No box is missed in which a ray meets a sphere: boxes are a few roundings larger than what they
hold, and so is the span of a ray in a box. Source of the latter: T. Ize, "Robust BVH Ray
Traversal", JCGT 2 (2013).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import drjit as dr

from ..core.arrays import Array, precision_of
from ..core.stack import Stack
from .hierarchy import DEPTH, END, LEAF, RECORD
from .sphere import Sphere

State = TypeVar("State")
# From a node and what has been found so far to what is found now
Look = Callable[["TreeNode", State], State]


@dataclass
class TreeNode:
    """A node of the tree (not frozen: Dr.Jit's loops write to their state)."""

    low: Array  # Array3f: the corners of its box; of a leaf, the center and the radius
    high: Array
    link: Array  # UInt32
    after: Array  # UInt32: the place of the node after it

    @property
    def is_leaf(self) -> Array:
        return (self.link & LEAF) != 0

    @property
    def number(self) -> Array:
        """The number of a leaf's sphere."""
        return self.link & (LEAF - 1)

    @property
    def sphere(self) -> Sphere:
        """The sphere of a leaf."""
        return Sphere("", "", self.low, -self.high.x)

    def holds(self, p: Array) -> Array:
        """Bool: a point is in the box."""
        return dr.all((p >= self.low) & (p <= self.high))


@dataclass
class Line:
    """A line, made ready for boxes."""

    o: Array
    inverse: Array  # of each component of the direction

    @staticmethod
    def of(o: Array, d: Array) -> "Line":
        return Line(o, 1 / d)

    def enters(self, node: TreeNode, t: Array) -> tuple[Array, Array]:
        """Where it enters a node's box, and Bool: it is there before the distance t."""
        one, two = (node.low - self.o) * self.inverse, (node.high - self.o) * self.inverse
        # A line within a side of a box gives NaN there, which `fmin` and `fmax` pass over
        near, far = dr.max(dr.fmin(one, two)), dr.min(dr.fmax(one, two))
        return near, _begins(near, far) & (far >= 0) & _begins(near, t)


def _begins(near: Array, t: Array) -> Array:
    """Bool: a distance is no larger than another one, as far as rounded numbers tell."""
    return near <= t * (1 + 8 * precision_of(t).epsilon)


def nodes_at(nodes: Array, place: Array, count: int) -> list[TreeNode]:
    """The node at a place, or the two of a pair at a place that is counted in pairs."""
    precision, size = precision_of(nodes), count * RECORD
    row = dr.gather(precision.columns, nodes, place, shape=(size, dr.width(place)))
    found = []
    for first in range(0, size, RECORD):
        low, high = (precision.vector(*(row[first + k + j] for j in range(3))) for k in (0, 3))
        found.append(TreeNode(low, -high, *(_bits(row[first + k]) for k in (6, 7))))
    return found


def _bits(x: Array) -> Array:
    """An integer that stands in the place of a number."""
    if dr.itemsize_v(x) == 4:
        single: Any = dr.uint32_array_t(x)
        return dr.reinterpret_array(single, x)
    double: Any = dr.uint64_array_t(x)
    return dr.uint32_array_t(x)(dr.reinterpret_array(double, x))


def walk_nodes(
    nodes: Array,
    state: State,
    active: Array,
    enters: Callable[[TreeNode, State], Array],
    look: Look,
    done: Callable[[State], Array] | None = None,
) -> State:
    """Visit all spheres whose boxes are of interest.

    Args:
        state: a structure of arrays, as wide as the wavefront.
        active: Bool: the lanes that walk.
        enters: Bool for a node: what is below it is of interest.
        look: called with each leaf.
        done: Bool: nothing more is to be found.
    """

    def step(place: Array, state: State, active: Array) -> tuple[Array, State, Array]:
        (node,) = nodes_at(nodes, place, 1)
        leaf = node.is_leaf
        state = dr.if_stmt((state,), leaf, lambda state: look(node, state), lambda state: state)
        place = dr.select(~leaf & enters(node, state), node.link, node.after)
        active = place != END
        return place, state, active if done is None else active & ~done(state)

    uint = dr.uint32_array_t(nodes)
    width = dr.width(state, active)
    start: Any = dr.zeros(uint, width), state, active & dr.ones(dr.mask_t(nodes), width)
    return dr.while_loop(start, lambda *s: s[-1], step, mode="symbolic", label="nodes")[1]


def nearest(
    nodes: Array,
    line: Line,
    state: State,
    distance: Callable[[State], Array],
    look: Look,
) -> State:
    """Visit the nodes that may have the nearest hit of a ray.

    Args:
        state: a structure of arrays, as wide as the wavefront.
        distance: of a state: that of the nearest hit so far.
        look: called with each node; it looks at leaves.
    """

    def step(state: State, pair: Array, stack: Stack, _: Array) -> tuple[Any, ...]:
        one, two = nodes_at(nodes, pair >> 1, 2)
        state = look(two, look(one, state))
        t = distance(state)
        (near, first), (far, second) = line.enters(one, t), line.enters(two, t)
        first, second = first & ~one.is_leaf, second & ~two.is_leaf
        swap = second & ~(first & (near <= far))
        link, other = dr.select(swap, two.link, one.link), dr.select(swap, one.link, two.link)
        stack = stack.push(first & second, other)
        more = ~first & ~second & (stack.size > 0)
        stack, pair = stack.pop(more, link)
        return state, pair, stack, first | second | more

    width = dr.width(line)
    zero = dr.zeros(dr.uint32_array_t(nodes), width)
    stack = Stack.allocate(DEPTH, zero, zero)
    start: Any = state, zero, stack, dr.ones(dr.mask_t(nodes), width)
    return dr.while_loop(start, lambda *s: s[-1], step, mode="symbolic", label="nearest")[0]
