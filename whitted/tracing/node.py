"""A node of the tree of rays: a ray that arrives at a surface, and what leaves from there."""

from dataclasses import dataclass, replace
from typing import TypeVar

import drjit as dr

from ..core.arrays import Array
from ..core.ray import Ray
from ..scene.scene import Scene
from ..shapes.sets import Hit
from .intersect import closest_hit
from .scatter import Branch, scatter
from .surface import Surface, surface


@dataclass(frozen=True)
class Limits:
    """Where the recursion ends."""

    capacity: int  # of stacks: no less than `depth`, and the same for many depths
    depth: Array  # UInt32: nodes on the longest chain
    importance: Array | None  # a child whose product of weights is below it is not traced
    # Edges at nodes whose product of weights is below it are left to the samples
    faint: Array = None
    # Levels of trees that images have as straight code, and whether a loop for the rest follows
    levels: int = 0
    loops: bool = True


# The parts of a `Link`: the number of the primitive that the ray starts on; whether the ray leaves
# into it; from bit 17 on, marks that walks use; from bit 22 on, the node's depth
SOURCE, INWARD, DEPTH = 0xFFFF, 1 << 16, 22
# Marks of a walk along a path: the ray is on the way to the path's node; it comes after that node.
# Marks of a walk in reverse mode: the node goes on with its first child; it has both children;
# something changes on the way to it.
ON, BELOW, FIRST, BOTH, MOVES = (1 << bit for bit in range(17, 22))


Own = TypeVar("Own", bound="Link")


@dataclass
class Link:
    """What is known of a ray besides its line, packed into one integer.

    (Not frozen: Dr.Jit's loops write to their state.)
    """

    word: Array  # UInt32

    @classmethod
    def of(cls, source: Array, inward: Array, depth: Array | int = 0) -> "Link":
        """The link of a ray that starts on a primitive, and arrives at a node of some depth."""
        return cls(source | _word(inward, depth))

    @property
    def source(self) -> Array:
        return self.word & SOURCE

    @property
    def inward(self) -> Array:
        return self.has(INWARD)

    @property
    def depth(self) -> Array:
        return self.word >> DEPTH

    def has(self, mark: int) -> Array:
        """Bool: the link has a mark."""
        return (self.word & mark) != 0

    def copy(self: Own) -> Own:
        """The same in arrays of its own."""
        return type(self)(*(part + 0 for part in vars(self).values()))

    def marked(self: Own, mark: int, where: Array) -> Own:
        """The link with a mark in some lanes."""
        return replace(self, word=self.word | dr.select(where, type(self.word)(mark), 0))


@dataclass
class WideLink(Link):
    """The same where primitives have numbers that take a word of their own."""

    number: Array  # UInt32

    @classmethod
    def of(cls, source: Array, inward: Array, depth: Array | int = 0) -> "Link":
        return cls(_word(inward, depth), source)

    @property
    def source(self) -> Array:
        return self.number


def _word(inward: Array, depth: Array | int) -> Array:
    uint = dr.uint32_array_t(inward)
    return dr.select(inward, uint(INWARD), 0) | (uint(depth) << DEPTH)


@dataclass
class Node:
    """A ray on its way to a surface (not frozen: Dr.Jit's loops write to their state)."""

    o: Array
    d: Array
    weight: Array  # product of the weights from the camera on
    link: Link

    @staticmethod
    def first(scene: Scene, ray: Ray) -> "Node":
        """The first node of a wavefront of rays, as wide as that."""
        width = dr.width(ray)
        nothing = dr.zeros(type(ray.o), width)
        weight, depth = dr.ones(dr.value_t(ray.o), width), dr.ones(type(ray.source), width)
        kind = Link if scene.many is None else WideLink
        source = ray.source + dr.zeros(type(ray.source), width)
        link = kind.of(source, ray.inward, depth)
        return Node(ray.o + nothing, ray.d + nothing, weight, link)

    @property
    def ray(self) -> Ray:
        return Ray(self.o, self.d, self.link.source, self.link.inward)

    @property
    def depth(self) -> Array:
        """Nodes from the camera on, this one included."""
        return self.link.depth


@dataclass(frozen=True)
class Visit:
    """A node's surface, and its children: the reflected one, then the refracted one."""

    node: Node
    at: Surface
    branches: list[Branch]

    @property
    def traced(self) -> list[Array]:
        """For each child, Bool: it is traced."""
        return [branch.active for branch in self.branches]

    def child(self, branch: Branch) -> Node:
        """The node that a branch leads to."""
        link = self.node.link.of(self.at.hit.index, branch.inward, self.node.depth + 1)
        return Node(self.at.p, branch.direction, self.node.weight * branch.weight, link)

    @property
    def children(self) -> list[Node]:
        return [self.child(branch) for branch in self.branches]


def visit(scene: Scene, node: Node, limits: Limits, hit: Hit | None = None) -> Visit:
    """Find the surface that a node's ray meets, and the rays that leave from there.

    The search for the hit, unless it is given, is detached; all else is differentiable in the scene
    and the node.
    """
    ray = node.ray
    hit = closest_hit(dr.detach(scene), dr.detach(ray)) if hit is None else hit
    at = surface(scene, ray, hit)
    branches = scatter(scene, ray, at)
    for branch in branches:
        branch.active &= node.depth < limits.depth
        if limits.importance is not None:
            branch.active &= abs(node.weight * branch.weight) >= limits.importance
    return Visit(node, at, branches)
