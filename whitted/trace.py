"""The Whitted recursion: closest hit -> each light -> reflect and refract, down to a fixed depth.

    L(ray, depth) = emitted + w_r L(reflected, depth + 1) + w_t L(refracted, depth + 1)

The binary tree of rays is walked depth first by one loop with a small stack, reflection before refraction. A packet
of rays takes as many steps as the largest tree among its rays has nodes, and a node is compiled once whatever the
depth: at depth 5 this compiles some 20 times faster than the same recursion unrolled into 31 nodes, runs faster, and
depth 20 needs nothing left out (`benchmarks/` has the figures). Scenes in which no material both reflects and
refracts get a chain without a stack, and scenes with neither a single node without a loop.

Source: T. Whitted, "An Improved Illumination Model for Shaded Display", CACM 23(6), 1980.
"""

from dataclasses import dataclass

import drjit as dr

from .decisions import decide, joined, mix
from .geometry import Array, Ray
from .optics import fresnel, reflect, refract, transmission
from .scene import Scene, closest_hit
from .shading import emitted
from .stack import Stack
from .surface import Surface, any_of, lookup, relative_index, surface


@dataclass
class Branch:
    """A child of a node: a ray that leaves from its surface."""

    weight: Array
    direction: Array
    inward: Array  # Bool: it leaves into the sphere that was hit
    active: Array  # Bool: it is to be traced


@dataclass(frozen=True)
class Limits:
    """Where the recursion ends."""

    max_depth: int  # nodes on the longest chain
    depth: Array  # UInt32: the same, opaque to the kernel
    importance: Array | None  # a child whose product of weights is below it is not traced
    faint: Array = None  # edges at nodes whose product of weights is below it are left to the samples

    def visible(self, scene: Scene) -> tuple[Array, ...]:
        """The least products of weights of the nodes that count for a label, or for each half of it."""
        return (self.faint, self.faint / 2) if varies(scene) else (self.faint,)


def reflects(scene: Scene) -> bool:
    """Whether any material can send a reflected ray: mirrors, and glass by total reflection."""
    return any(scene.may(m, "reflection") or scene.may(m, "refraction") for m in scene.used)


def refracts(scene: Scene) -> bool:
    return any(scene.may(m, "refraction") for m in scene.used)


def branches_out(scene: Scene) -> bool:
    """Whether any material can send both rays at once; without one the tree is a chain."""
    return any(scene.may(m, "reflection") and scene.may(m, "refraction") for m in scene.used)


def varies(scene: Scene) -> bool:
    """Whether the weight of a path can change while no decision flips."""
    return any(m.fresnel for m in scene.used) and refracts(scene)


def scatter(scene: Scene, ray: Ray, at: Surface) -> list[Branch]:
    """The reflected and then the refracted child, as far as the scene's materials can send them."""
    if not reflects(scene):
        return []
    reflection = _weight(scene, at, "reflection")
    dielectric = any_of(scene, at, lambda m: m.fresnel)
    mirror = reflect(ray.d, at.n)
    if not refracts(scene):
        # Media are equal everywhere, where a dielectric reflects nothing
        weight = dr.select(dielectric, 0, reflection)
        return [Branch(weight, mirror, at.hit.inside, _carries(scene, at, "reflection", weight, reflection))]

    refraction = _weight(scene, at, "refraction")
    cos_theta_i = dr.fmax(-dr.dot(at.n, ray.d), 0)
    eta = relative_index(scene, at)
    squared, total = transmission(cos_theta_i, eta)
    positive = squared > 0
    cos_theta_t = dr.select(positive, dr.sqrt(dr.select(positive, squared, 1)), 0)
    mirror_weight, weight = reflection + dr.select(total, refraction, 0), dr.select(total, 0, refraction)
    if any(m.fresnel for m in scene.used):
        reflectance = dr.select(total, 1, fresnel(cos_theta_i, cos_theta_t, eta))
        mirror_weight = dr.select(dielectric, reflection * reflectance, mirror_weight)
        weight = dr.select(dielectric, refraction * (1 - reflectance), weight)
    direction = refract(ray.d, at.n, cos_theta_i, cos_theta_t, eta)
    passes = _carries(scene, at, "refraction", weight, refraction) & ~total
    mirrored = Branch(mirror_weight, mirror, at.hit.inside, _carries(scene, at, "reflection", mirror_weight, reflection))
    return [mirrored, Branch(weight, direction, ~at.hit.inside, passes)]


def _weight(scene: Scene, at: Surface, field: str) -> Array:
    return lookup(scene, at, field, lambda m: scene.may(m, field))


def _carries(scene: Scene, at: Surface, field: str, weight: Array, coefficient: Array) -> Array:
    """Whether a child is to be traced: its weight is not 0, or the 0 is being differentiated."""
    carries = weight != 0
    if dr.grad_enabled(coefficient):
        carries |= any_of(scene, at, lambda m: scene.may(m, field))
    return carries


def radiance(scene: Scene, ray: Ray, limits: Limits) -> Array:
    """Radiance along rays.

    Args:
        scene: with unit plane normals, and no gradients (`derivative.py` has those).
        ray: a wavefront of rays.
        limits: where the recursion ends.

    Returns:
        Array3f, linear RGB.
    """
    return _walk(scene, ray, limits, ())[0]


def labelled_radiance(scene: Scene, ray: Ray, limits: Limits) -> tuple[Array, Array]:
    """Radiance along rays, and the labels of their trees, which are hashes of all decisions (`decisions.py`)."""
    nothing = dr.zeros(type(ray.source), dr.width(ray))
    light, halves = _walk(scene, ray, limits, tuple(nothing + k for k in range(1, 1 + len(limits.visible(scene)))))
    return light, joined(halves)


def labelled(scene: Scene, ray: Ray, at: Surface, weight: Array, active: list[Array], label: tuple, limits: Limits) -> tuple:
    """The label's halves with the decisions of a node, whose children are given as whether they are traced."""
    decided = decide(scene, ray, at, active)
    halves = zip(limits.visible(scene), label, strict=True)
    return tuple(dr.select(dr.abs(weight) >= least, mix(part, decided), part) for least, part in halves)


def _walk(scene: Scene, ray: Ray, limits: Limits, label: tuple) -> tuple[Array, tuple]:
    """Radiance, and unless they are empty the label's halves with all nodes' decisions mixed in."""

    def look(ray, at, weight, active, label):
        return labelled(scene, ray, at, weight, active, label, limits) if label else label

    if not reflects(scene):
        at = surface(scene, ray, closest_hit(scene, ray))
        return emitted(scene, ray, at), look(ray, at, dr.ones(type(at.hit.t)), [], label)

    def node(path, result, label, stack, active):
        o, d, weight, links = path
        ray, depth = unpack(o, d, links)
        at = surface(scene, ray, closest_hit(scene, ray))
        result = dr.fma(weight, emitted(scene, ray, at), result)
        branches = children(scene, ray, at, weight, depth, limits)
        traced = [branch.active for branch in branches]
        label = look(ray, at, weight, traced, label)
        paths = [(at.p, b.direction, weight * b.weight, pack(at.hit.index, b.inward, depth + 1)) for b in branches]
        stack, active, path = go_on(stack, traced, paths)
        return path, result, label, stack, active

    path = (*start(ray), pack(ray.source, ray.inward, dr.ones(type(ray.source), dr.width(ray))))
    stack = allocate(scene, limits, path)
    state = path, dr.zeros(type(ray.o), dr.width(ray)), label, stack, dr.ones(type(ray.inward), dr.width(ray))
    state = dr.while_loop(state, lambda *state: state[-1], node, mode="symbolic", label="radiance")
    return state[1], state[2]


def start(ray: Ray) -> tuple[Array, Array, Array]:
    """Origin, direction and weight of a chain's first ray, all as wide as the wavefront."""
    nothing = dr.zeros(type(ray.o), dr.width(ray))
    return ray.o + nothing, ray.d + nothing, dr.ones(type(ray.o.x), dr.width(ray))


def allocate(scene: Scene, limits: Limits, path: tuple) -> Stack:
    """A stack for paths, which needs no slots where the tree of rays is a chain."""
    size = dr.zeros(dr.uint32_array_t(type(limits.depth)), dr.width(path))
    return Stack.allocate(limits.max_depth if branches_out(scene) else 0, size, *path)


def children(scene: Scene, ray: Ray, at: Surface, weight: Array, depth: Array, limits: Limits) -> list[Branch]:
    """A node's children, active as far as the limits let them."""
    branches = scatter(scene, ray, at)
    for branch in branches:
        branch.active &= depth < limits.depth
        if limits.importance is not None:
            branch.active &= abs(weight * branch.weight) >= limits.importance
    return branches


def go_on(stack: Stack, active: list[Array], paths: list[tuple]) -> tuple[Stack, Array, tuple]:
    """Go on with a node's first active child, and where it has none with the path that was put off last.

    Args:
        active: for each of the node's one or two children.
        paths: the same children, as tuples of arrays.

    Returns:
        The stack, whether there is a path to go on with, and the path.
    """
    if len(paths) == 1:
        return stack, active[0], paths[0]
    first, second = active
    path = tuple(dr.select(first, a, b) for a, b in zip(*paths, strict=True))
    if not stack.slots:
        return stack, first | second, path
    stack = stack.push(first & second, *paths[1])
    more = ~first & ~second & (stack.size > 0)
    stack, *parts = stack.pop(more, *path)
    return stack, first | second | more, tuple(parts)


def pack(source: Array, inward: Array, depth: Array) -> Array:
    """Where a ray starts, which way it leaves, and its depth, in one integer."""
    return source | dr.select(inward, type(depth)(1 << 16), 0) | (depth << 17)


def unpack(o: Array, d: Array, links: Array) -> tuple[Ray, Array]:
    """The ray and its depth."""
    return Ray(o, d, links & 0xFFFF, (links & (1 << 16)) != 0), links >> 17
