"""Derivatives of the Whitted recursion, walked like the recursion itself with automatic differentiation at each node.

Dr.Jit cannot record a loop with a stack for reverse mode, and need not: a node is a small function of its ray and the
scene, and a tree of nodes is the chain rule. Forward mode carries each ray's tangent down the tree. Reverse mode
returns up the tree: a node's own light is differentiated on arrival, and each child when it comes back with the
adjoints of its ray and the light that it saw. No intermediate image is stored, whatever the depth.

These are derivatives of samples; what moves with an edge is not in them.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import drjit as dr

from .geometry import Array, Ray
from .scene import Hit, Scene, closest_hit
from .shading import emitted
from .stack import Stack
from .surface import surface
from .trace import Branch, Limits, branches_out, children, choose, pack, reflects, scatter, unpack

Parameters = Mapping[str, Array]


@dataclass
class Adjoint:
    """What a traced ray returns to its parent: derivatives by its origin and direction, and its adjoint-weighted light."""

    o: Array
    d: Array
    value: Array


def push_forward(inputs: object) -> None:
    """Propagate the inputs' tangents to all that depends on them, keeping those of values in between."""
    dr.enqueue(dr.ADMode.Forward, inputs)
    dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearEdges)


def radiance_jvp(scene: Scene, tangents: Parameters, ray: Ray, ray_tangent: tuple, limits: Limits) -> tuple[Array, Array]:
    """Radiance along rays and its derivative in one direction of parameter space (forward mode).

    Args:
        scene: with unit plane normals.
        tangents: parameter name to tangent, of width 1; other parameters stand still.
        ray_tangent: tangents of the rays' origins and directions.
    """
    uint, mask, width = type(ray.source), dr.mask_t(ray.o.x), dr.width(ray)

    def node(ray, ray_tangent, weight, weight_tangent, depth, result, result_tangent, stack, active):
        still, seeds = Ray(ray.o, ray.d, ray.source, ray.inward), {name: scene.parameters(name)[name] for name in tangents}
        inputs = dr.detach((ray.o, ray.d, weight, seeds))
        dr.enable_grad(inputs)
        dr.set_grad(inputs, (*ray_tangent, weight_tangent, dict(tangents)))
        o, d, weight, seeds = inputs
        moving, there = scene.carrying(seeds), Ray(o, d, ray.source, ray.inward)
        at = surface(moving, there, closest_hit(scene, still))
        light = weight * emitted(moving, there, at)
        branches = children(moving, there, at, weight, depth, limits)
        for branch in branches:
            branch.weight = branch.weight * weight
        push_forward(inputs)
        result, result_tangent = result + dr.detach(light), result_tangent + dr.grad(light)
        p, p_tangent = dr.detach(at.p), dr.grad(at.p)
        if not branches:
            return ray, ray_tangent, weight, weight_tangent, depth, result, result_tangent, stack, mask(False)
        plain = [dr.detach(b) for b in branches]
        slope = [Branch(dr.grad(b.weight), dr.grad(b.direction), b.inward, b.active) for b in branches]
        first = plain[0].active
        go, go_slope = (choose(first, *plain), choose(first, *slope)) if len(plain) == 2 else (plain[0], slope[0])
        if stack.slots:
            later, later_slope = plain[1], slope[1]
            links = pack(Ray(p, later.direction, at.hit.index, later.inward), depth + 1)
            parts = p, later.direction, p_tangent, later_slope.direction, later.weight, later_slope.weight, links
            stack = stack.push(first & later.active, *parts)
        ray, ray_tangent = Ray(p, go.direction, at.hit.index, go.inward), (p_tangent, go_slope.direction)
        weight, weight_tangent, active = go.weight, go_slope.weight, go.active
        depth += 1
        if stack.slots:
            more = ~active & (stack.size > 0)
            parts = ray.o, ray.d, *ray_tangent, weight, weight_tangent, pack(ray, depth)
            stack, o, d, o_tangent, d_tangent, weight, weight_tangent, links = stack.pop(more, *parts)
            ray, depth = unpack(o, d, links)
            ray_tangent = o_tangent, d_tangent
            active |= more
        return ray, ray_tangent, weight, weight_tangent, depth, result, result_tangent, stack, active

    real = type(ray.o.x)
    one, none, dark = dr.ones(real, width), dr.zeros(real, width), dr.zeros(type(ray.o), width)
    parts = ray.o, ray.d, ray.o, ray.d, one, one, ray.source
    stack = Stack.allocate(limits.max_depth if branches_out(scene) else 0, dr.zeros(uint, width), *parts)
    state = ray, ray_tangent, one, none, dr.ones(uint, width), dark, dark, stack, dr.ones(mask, width)
    if not reflects(scene):
        return node(*state)[5:7]
    return dr.while_loop(state, lambda *state: state[-1], node, mode="symbolic", label="radiance_jvp")[5:7]


def radiance_vjp(scene: Scene, sums: Parameters, ray: Ray, limits: Limits, seed: Array, wide: Parameters) -> tuple:
    """Derivatives of dot(seed, radiance) (reverse mode).

    Args:
        scene: with unit plane normals.
        sums: parameter name to the derivatives so far, as wide as the wavefront; theirs are added.
        seed: Array3f, the adjoint of the radiance.
        wide: parameter name to value, as wide as the wavefront, which keeps each lane's derivative in its lane.

    Returns:
        The sums, and the derivatives by the rays' origins and directions.
    """
    real, uint, width = type(ray.o.x), type(ray.source), dr.width(ray)

    def attached(ray):
        """The scene and the ray with fresh gradients."""
        values, o, d = dr.detach(dict(wide)), dr.detach(ray.o), dr.detach(ray.d)
        dr.enable_grad(values, o, d)
        return scene.carrying(values), Ray(o, d, ray.source, ray.inward), values

    def descend(value, seed, values, sums):
        """Propagate `seed` from `value` back to the attached values."""
        dr.set_grad(value, seed)
        dr.enqueue(dr.ADMode.Backward, value)
        dr.traverse(dr.ADMode.Backward)
        return {name: sums[name] + dr.grad(values[name]) for name in sums}

    def arrive(ray, weight, back, stack, sums):
        """Trace a ray: differentiate the light of its surface, then go on with its first child."""
        hit = closest_hit(scene, ray)
        moving, there, values = attached(ray)
        at = surface(moving, there, hit)
        branches = dr.detach(children(moving, there, at, weight, stack.size + 1, limits))
        value = dr.dot(seed, emitted(moving, there, at))
        sums = descend(value, weight, values, sums)
        back = Adjoint(dr.grad(there.o), dr.grad(there.d), dr.detach(value))
        if not branches:
            return ray, weight, back, stack, sums, dr.mask_t(weight)(False)
        first, *second = branches
        go = choose(first.active, first, second[0]) if second else first
        pending = first.active & second[0].active if second else dr.mask_t(weight)(False)
        links = hit.index | flag(hit.inside, 16) | flag(first.active, 17) | flag(pending, 18)
        stack = stack.push(go.active, ray.o, ray.d, back.o, back.d, hit.t, weight, back.value, links)
        return Ray(dr.detach(at.p), go.direction, hit.index, go.inward), weight * go.weight, back, stack, sums, go.active

    def flag(mask, bit):
        return dr.select(mask, uint(1 << bit), 0)

    def come_back(ray, weight, back, stack, sums, tracing):
        """Take a child's adjoints through its parent, then go on with the second child or return further."""
        zero = dr.zeros(real, width), dr.zeros(uint, width)
        here = dr.mask_t(weight)(True)
        stack, o, d, o_adjoint, d_adjoint, t, weight, value, links = stack.pop(here, ray.o, ray.d, ray.o, ray.d, *3 * zero[:1], zero[1])
        index, inside, first, pending = links & 0xFFFF, *((links & (1 << bit)) != 0 for bit in (16, 17, 18))
        moving, there, values = attached(Ray(o, d, index, inside))
        at = surface(moving, there, Hit(t, index, inside))
        branches = scatter(moving, there, at)
        child = choose(first, *branches) if len(branches) == 2 else branches[0]
        total = dr.dot(at.p, back.o) + dr.dot(child.direction, back.d) + child.weight * (weight * back.value)
        sums = descend(total, real(1), values, sums)
        value += dr.detach(child.weight) * back.value
        back = Adjoint(o_adjoint + dr.grad(there.o), d_adjoint + dr.grad(there.d), value)
        if len(branches) == 2:
            second = dr.detach(branches[1])
            links = index | flag(inside, 16)
            stack = stack.push(pending, o, d, back.o, back.d, t, weight, value, links)
            ray, weight = Ray(dr.detach(at.p), second.direction, index, second.inward), weight * second.weight
        return ray, weight, back, stack, sums, pending

    def step(ray, weight, back, stack, sums, tracing):
        state = ray, weight, back, stack, sums
        state = dr.if_stmt(state, tracing, arrive, lambda *state: (*state, dr.mask_t(weight)(False)))
        if not reflects(scene):
            return state
        returning = ~state[-1] & (state[3].size > 0)
        return dr.if_stmt(state, returning, come_back, lambda *state: state)

    zero, none = dr.zeros(real, width), dr.zeros(type(ray.o), width)
    parts = ray.o, ray.d, ray.o, ray.d, zero, zero, zero, ray.source
    stack = Stack.allocate(limits.max_depth if reflects(scene) else 0, dr.zeros(uint, width), *parts)
    state = ray, dr.ones(real, width), Adjoint(none, none, zero), stack, dict(sums), dr.ones(dr.mask_t(zero), width)
    going = lambda ray, weight, back, stack, sums, tracing: tracing | (stack.size > 0)  # noqa: E731
    state = dr.while_loop(state, going, step, mode="symbolic", label="radiance_vjp")
    return state[4], state[2].o, state[2].d
