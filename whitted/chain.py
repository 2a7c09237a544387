"""One chain of rays in the tree: the way from the camera to the node where an edge has its cause.

An edge of the image is one decision, at one node, that flips. The node is reached by one chain of reflections and
refractions, so that finding the edge and its motion costs a chain, and not the tree.
"""

from dataclasses import dataclass
from typing import Any

import drjit as dr

from .decisions import decide, flips, joined
from .geometry import Array, Ray
from .scene import Scene, closest_hit
from .shading import emitted
from .surface import surface
from .trace import (
    Branch,
    Limits,
    allocate,
    children,
    go_on,
    labelled,
    labelled_radiance,
    pack,
    reflects,
    start,
    unpack,
)

# Bounces whose choice between reflection and refraction a path remembers; beyond, where a node has both children, it
# goes on with the reflected one
REMEMBERED = 64
# Bits beside those of `trace.pack`: the ray is on the way to a path's node, or comes after it
ON, BELOW = 1 << 30, 1 << 31


@dataclass
class Path:
    """The way to a node (not frozen: Dr.Jit's loops write to their state)."""

    bounces: Array  # UInt32: how many rays come before the node's own
    turns: Array  # UInt64: a bit for each bounce, 1 where it goes on with the refracted ray


@dataclass
class Arrival:
    """A ray that arrives at a node, and the product of weights down to it."""

    ray: Ray
    weight: Array


def turn(path: Path, bounce: Array) -> Array:
    """Whether a path goes on with the refracted ray of a node that sends both."""
    return ((path.turns >> type(path.turns)(bounce)) & 1) != 0


def take(branches: list[Branch], refracted: Array) -> tuple[Branch, Array]:
    """The child that a path goes on with, and whether it is the first: the only active one, or the one it turns to."""
    if len(branches) == 1:
        return branches[0], type(refracted)(True)
    a, b = branches
    first = a.active & ~(b.active & refracted)
    chosen = Branch(
        dr.select(first, a.weight, b.weight),
        dr.select(first, a.direction, b.direction),
        dr.select(first, a.inward, b.inward),
        a.active | b.active,
    )
    return chosen, first


def follow(scene: Scene, ray: Ray, path: Path, limits: Limits) -> Arrival:
    """Trace one chain down to its node."""
    o, d, weight = start(ray)
    width = dr.width(o)
    nothing = dr.zeros(type(ray.source), width)
    if not reflects(scene):
        return Arrival(Ray(o, d, ray.source | nothing, ray.inward), weight)

    def step(o, d, weight, links, active):
        ray, depth = unpack(o, d, links)
        at = surface(scene, ray, closest_hit(scene, ray))
        child, _ = take(children(scene, ray, at, weight, depth, limits), turn(path, depth - 1))
        links = pack(at.hit.index, child.inward, depth + 1)
        return at.p, child.direction, weight * child.weight, links, child.active & (depth < path.bounces)

    links = pack(ray.source, ray.inward, nothing + 1)
    state = o, d, weight, links, path.bounces > 0
    o, d, weight, links, _ = dr.while_loop(state, lambda *state: state[-1], step, mode="symbolic", label="follow")
    return Arrival(unpack(o, d, links)[0], weight)


def contrasted(scene: Scene, ray: Ray, path: Path, limits: Limits) -> tuple[Array, Array]:
    """Radiance along rays, as far as it may change where the decisions of a path's node flip, and labels.

    What is too faint for an edge is left out unless the light of that node is in it: to both sides of the edge it is the same.
    """
    if not reflects(scene):
        return labelled_radiance(scene, ray, limits)
    uint, width = type(ray.source), dr.width(ray)
    least = limits.visible(scene)

    def node(chain, light, label, stack, active):
        o, d, weight, links = chain
        ray, depth = unpack(o, d, links & (ON - 1))
        at = surface(scene, ray, closest_hit(scene, ray))
        light = dr.fma(weight, emitted(scene, ray, at), light)
        branches = children(scene, ray, at, weight, depth, limits)
        label = labelled(scene, ray, at, weight, [branch.active for branch in branches], label, limits)
        on = (links & ON) != 0
        below = ((links & BELOW) != 0) | (on & (depth > path.bounces))
        _, first = take(branches, turn(path, depth - 1))
        onward, chains = [], []
        for branch, taken in zip(branches, (first, ~first), strict=False):
            passed = weight * branch.weight
            marks = dr.select(below, BELOW, dr.select(on & taken, uint(ON), 0))
            onward.append(branch.active & (below | (on & taken) | (dr.abs(passed) >= least[-1])))
            chains.append((at.p, branch.direction, passed, pack(at.hit.index, branch.inward, depth + 1) | marks))
        stack, active, chain = go_on(stack, onward, chains)
        return chain, light, label, stack, active

    chain = (*start(ray), pack(ray.source, ray.inward, dr.ones(uint, width)) | ON)
    label = tuple(dr.full(uint, 1 + k, width) for k in range(len(least)))
    state: Any = chain, dr.zeros(type(ray.o), width), label, allocate(scene, limits, chain), dr.ones(type(ray.inward), width)
    state = dr.while_loop(state, lambda *state: state[-1], node, mode="symbolic", label="contrasted")
    return state[1], joined(state[2])


def strongest_difference(scene: Scene, a: Ray, b: Ray, limits: Limits) -> tuple[Path, Arrival, Arrival, Array]:
    """Walk the trees of two rays at once for the node of the largest weight at which they decide differently.

    Returns:
        The path to the node, the two rays that arrive at it, and whether there is such a node.
    """
    uint = type(a.source)
    long: Any = dr.uint64_array_t(uint)

    def node(pair, stack, best, active):
        (oa, da, wa, links, turns), (ob, db, wb) = pair
        ray, depth = unpack(oa, da, links)
        other = Ray(ob, db, ray.source, ray.inward)
        at, to = surface(scene, ray, closest_hit(scene, ray)), surface(scene, other, closest_hit(scene, other))
        left, right = children(scene, ray, at, wa, depth, limits), children(scene, other, to, wb, depth, limits)
        decided = [decide(scene, w, x, [z.active for z in y]) for w, x, y in ((ray, at, left), (other, to, right))]
        weight = heavier(wa, wb)
        differ = flips(*decided) & (weight >= limits.faint)
        paths = []
        for k, (x, y) in enumerate(zip(left, right, strict=True)):
            turned = turns | (long(1) << dr.minimum(long(depth - 1), REMEMBERED - 1)) if k else turns
            one = at.p, x.direction, wa * x.weight, pack(at.hit.index, x.inward, depth + 1), turned
            paths.append((*one, to.p, y.direction, wb * y.weight))
        best = dr.select(differ & (weight > heavier(best[0][2], best[1][2])), pair, best)
        if not paths:
            return pair, stack, best, dr.mask_t(active)(False)
        # Below a node all weigh less: where that is too faint for an edge, or than the best so far, there is none of use
        least = dr.fmax(limits.faint, heavier(best[0][2], best[1][2]))
        onward = [x.active & ~differ & (heavier(path[2], path[7]) >= least) for x, path in zip(left, paths, strict=True)]
        stack, more, parts = go_on(stack, onward, paths)
        return (parts[:5], parts[5:]), stack, best, more

    oa, da, wa = start(a)
    ob, db, wb = start(b)
    links = pack(a.source, a.inward, dr.ones(uint, dr.width(oa)))
    pair: Any = (oa, da, wa, links, dr.zeros(long, dr.width(oa))), (ob, db, wb)
    none: Any = (
        (oa + 0, da + 0, dr.zeros(type(wa), dr.width(oa)), links + 0, pair[0][4] + 0),
        (ob + 0, db + 0, dr.zeros(type(wb), dr.width(ob))),
    )
    state = pair, allocate(scene, limits, (*pair[0], *pair[1])), none, dr.ones(type(a.inward), dr.width(oa))
    if reflects(scene):
        state = dr.while_loop(state, lambda *state: state[-1], node, mode="symbolic", label="strongest_difference")
    else:
        state = node(*state)
    (oa, da, wa, links, turns), (ob, db, wb) = state[2]
    ray, depth = unpack(oa, da, links)
    path = Path(depth - 1, turns)
    return path, Arrival(ray, wa), Arrival(Ray(ob, db, ray.source, ray.inward), wb), heavier(wa, wb) > 0


def heavier(a: Array, b: Array) -> Array:
    """The larger one of two weights: between a silhouette and a sample it may be that of the one or the other."""
    return dr.fmax(dr.abs(a), dr.abs(b))
