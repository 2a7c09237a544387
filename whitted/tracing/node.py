"""A node of the tree of rays: a ray that arrives at a surface, and what leaves from there."""

from dataclasses import dataclass, replace

import drjit as dr

from ..core.arrays import Array
from ..core.numerics import safe_sqrt
from ..core.ray import Ray
from ..scene.features import bends, may, reflects, refracts
from ..scene.scene import Scene
from ..shapes.sets import Hit
from .intersect import closest_hit
from .media import relative_index
from .optics import fresnel, reflect, refract, transmission
from .surface import Surface, any_of, lookup, surface


@dataclass(frozen=True)
class Limits:
    """Where the recursion ends."""

    max_depth: int  # nodes on the longest chain
    depth: Array  # UInt32: the same, opaque to the kernel
    importance: Array | None  # a child whose product of weights is below it is not traced
    faint: Array = (
        None  # edges at nodes whose product of weights is below it are left to the samples
    )


# What a word holds: the primitive that the ray starts on, whether it leaves into it, marks of a
# walk, and the depth
SOURCE, INWARD, DEPTH = 0xFFFF, 1 << 16, 22
# Marks: of a walk that follows a path, the ray is on the way to the path's node, or comes after it;
# of a walk in reverse mode, a node goes on with its first child, has both, and something changes on
# the way to it
ON, BELOW, FIRST, BOTH, MOVES = (1 << bit for bit in range(17, 22))


@dataclass
class Link:
    """What is known of a ray besides its line, in one integer (not frozen: Dr.Jit's loops write to
    their state).
    """

    word: Array  # UInt32

    @staticmethod
    def of(source: Array, inward: Array, depth: Array | int = 0) -> "Link":
        """A ray that starts on a primitive, leaves into it or not, and arrives at a node of some
        depth.
        """
        uint = dr.uint32_array_t(inward)
        return Link(source | dr.select(inward, uint(INWARD), 0) | (uint(depth) << DEPTH))

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
        return (self.word & mark) != 0

    def marked(self, mark: int, where: Array) -> "Link":
        return Link(self.word | dr.select(where, type(self.word)(mark), 0))


@dataclass
class Node:
    """A ray on its way to a surface (not frozen: Dr.Jit's loops write to their state)."""

    o: Array
    d: Array
    weight: Array  # product of the weights from the camera on
    link: Link

    @staticmethod
    def first(ray: Ray) -> "Node":
        """The first node of a wavefront of rays, as wide as that."""
        width = dr.width(ray)
        nothing = dr.zeros(type(ray.o), width)
        weight, depth = dr.ones(dr.value_t(ray.o), width), dr.ones(type(ray.source), width)
        return Node(
            ray.o + nothing, ray.d + nothing, weight, Link.of(ray.source, ray.inward, depth)
        )

    @property
    def ray(self) -> Ray:
        return Ray(self.o, self.d, self.link.source, self.link.inward)

    @property
    def depth(self) -> Array:
        """Nodes from the camera on, this one included."""
        return self.link.depth


@dataclass
class Branch:
    """A child of a node: a ray that leaves from its surface."""

    weight: Array
    direction: Array
    inward: Array  # Bool: it leaves into the primitive that was hit
    active: Array  # Bool: it is to be traced


@dataclass(frozen=True)
class Visit:
    """A node's surface, and its children: the reflected one, then the refracted one."""

    node: Node
    at: Surface
    branches: list[Branch]

    @property
    def traced(self) -> list[Array]:
        """For each child, whether it is traced."""
        return [branch.active for branch in self.branches]

    def child(self, branch: Branch) -> Node:
        """The node that a branch leads to."""
        link = Link.of(self.at.hit.index, branch.inward, self.node.depth + 1)
        return Node(self.at.p, branch.direction, self.node.weight * branch.weight, link)

    @property
    def children(self) -> list[Node]:
        return [self.child(branch) for branch in self.branches]


def visit(scene: Scene, node: Node, limits: Limits, hit: Hit | None = None) -> Visit:
    """Find the surface that a node's ray meets, if it is not known, and the rays that leave from
    it.

    The search is detached; all else is differentiable in the scene and the node.
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


def scatter(scene: Scene, ray: Ray, at: Surface) -> list[Branch]:
    """The reflected and then the refracted child, as far as the scene's materials can send them."""
    if not reflects(scene):
        return []
    reflection = lookup(scene, at, "reflection")
    mirror = reflect(ray.d, at.n)
    if not bends(scene):
        return [_branch(scene, at, "reflection", reflection, reflection, mirror, at.hit.inside)]

    refraction = lookup(scene, at, "refraction")
    cos_theta_i = dr.fmax(-dr.dot(at.n, ray.d), 0)
    eta = relative_index(scene, at)
    squared, total = transmission(cos_theta_i, eta)
    cos_theta_t = safe_sqrt(squared)
    mirrored, passed = reflection + dr.select(total, refraction, 0), dr.select(total, 0, refraction)
    if any(material.fresnel for material in scene.used):
        dielectric = any_of(scene, at, lambda m: m.fresnel)
        reflectance = dr.select(total, 1, fresnel(cos_theta_i, cos_theta_t, eta))
        mirrored = dr.select(dielectric, reflection * reflectance, mirrored)
        passed = dr.select(dielectric, refraction * (1 - reflectance), passed)
    first = _branch(scene, at, "reflection", mirrored, reflection, mirror, at.hit.inside)
    if not refracts(scene):
        return [first]
    direction = refract(ray.d, at.n, cos_theta_i, cos_theta_t, eta)
    second = _branch(scene, at, "refraction", passed, refraction, direction, ~at.hit.inside)
    return [first, replace(second, active=second.active & ~total)]


def _branch(
    scene: Scene,
    at: Surface,
    field: str,
    weight: Array,
    coefficient: Array,
    direction: Array,
    inward: Array,
) -> Branch:
    """A child, active where its weight is not 0, or where a 0 is being differentiated.

    Args:
        field: of the material, "reflection" or "refraction"; coefficient is its value.
    """
    active = weight != 0
    if dr.grad_enabled(coefficient):
        active |= any_of(scene, at, lambda m: may(scene, m, field))
    return Branch(weight, direction, inward, active)
