"""Derivatives of the Whitted recursion, walked like the recursion itself with automatic differentiation at each node.

Dr.Jit cannot record a loop with a stack for reverse mode, and need not: a node is a small function of its ray and the
scene, and a tree of nodes is the chain rule. Forward mode carries each ray's tangent down the tree. Reverse mode
returns up the tree: a node's own light is differentiated on arrival, and each child when it comes back with the
adjoints of its ray and the light that it saw. No intermediate image is stored, whatever the depth.

These are derivatives of samples; what moves with an edge is not in them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr

from .chain import Arrival, Path, take, turn
from .events import Event, level_function, place
from .geometry import Array, Ray
from .scene import Hit, Scene, closest_hit
from .shading import emitted
from .stack import Stack
from .surface import surface, transparent
from .trace import Branch, Limits, allocate, branches_out, children, go_on, pack, reflects, scatter, start, unpack

Parameters = Mapping[str, Array]


def push_forward(inputs: object) -> None:
    """Propagate the inputs' tangents to all that depends on them, keeping those of values in between."""
    dr.enqueue(dr.ADMode.Forward, inputs)
    dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearEdges)


def pull_back(output: Array, adjoint: Array) -> None:
    """Propagate an output's adjoint to all that it depends on."""
    dr.set_grad(output, adjoint)
    dr.enqueue(dr.ADMode.Backward, output)
    dr.traverse(dr.ADMode.Backward)


def radiance_jvp(scene: Scene, tangents: Parameters, ray: Ray, o_slope: Array, d_slope: Array, limits: Limits) -> Array:
    """The derivative of radiance along rays, in one direction of parameter space (forward mode).

    Args:
        scene: with unit plane normals, and no gradients.
        tangents: parameter name to tangent, of width 1; other parameters stand still.
        o_slope, d_slope: tangents of the rays' origins and directions.

    Returns:
        Array3f, the tangent of `trace.radiance`.
    """
    changed = _changed(scene, tangents)

    def light(dark, path, slope, hit):
        inputs, moving, ray, _ = _moving(scene, tangents, path, slope)
        value = inputs[2] * emitted(moving, ray, surface(moving, ray, hit))
        push_forward(inputs)
        return dr.grad(value)

    def node(path, slope, result, stack, active):
        inputs, moving, ray, depth = _moving(scene, tangents, path, slope)
        hit = closest_hit(scene, dr.detach(ray))
        moves = dr.any(slope[0] != 0) | dr.any(slope[1] != 0) | (slope[2] != 0)
        moves = _among(changed, hit, moves)
        if changed is None:
            result += light(dark, path, slope, hit)
        else:
            result += dr.if_stmt((dark, path, slope, hit), moves, light, lambda dark, *_: dark)
        at, weight = surface(moving, ray, hit), inputs[2]
        branches = children(moving, ray, at, weight, depth, limits)
        if not branches:
            return path, slope, result, stack, dr.mask_t(active)(False)
        rays = [(at.p, branch.direction, weight * branch.weight) for branch in branches]
        push_forward(inputs)
        links = [pack(at.hit.index, branch.inward, depth + 1) for branch in branches]
        paths = [(*dr.detach(r), link, *(dr.grad(x) for x in r)) for r, link in zip(rays, links, strict=True)]
        stack, active, path = go_on(stack, [branch.active for branch in branches], paths)
        return path[:4], path[4:], result, stack, active

    width = dr.width(ray)
    path = (*start(ray), pack(ray.source, ray.inward, dr.ones(type(ray.source), width)))
    dark = dr.zeros(type(ray.o), width)
    slope = o_slope + dark, d_slope + dark, dr.zeros(type(ray.o.x), width)
    state = path, slope, dark, allocate(scene, limits, (*path, *slope)), dr.ones(type(ray.inward), width)
    if not reflects(scene):
        return node(*state)[2]
    return dr.while_loop(state, lambda *state: state[-1], node, mode="symbolic", label="radiance_jvp")[2]


def level_jvp(
    scene: Scene, tangents: Parameters, ray: Ray, slopes: Sequence[tuple], limits: Limits, edge: "Edge"
) -> tuple[list[tuple], Ray]:
    """The derivatives of the level function of an event at the end of a chain, in several directions (forward mode).

    Args:
        slopes: for each direction, tangents of the rays' origins and directions; others are as for `radiance_jvp`.

    Returns:
        For each direction the derivatives of the level function, of the column and the row of a checkerboard there
        (`events.place`), and of the direction of the ray that arrives; and that ray.
    """

    def bounce(path, slopes, active):
        moved = []
        # What does not depend on the direction, Dr.Jit computes once
        for slope in slopes:
            inputs, moving, ray, depth = _moving(scene, tangents, path, slope)
            at = surface(moving, ray, closest_hit(scene, dr.detach(ray)))
            child, _ = take(children(moving, ray, at, inputs[2], depth, limits), turn(edge.path, depth - 1))
            outputs = at.p, child.direction, inputs[2] * child.weight
            push_forward(inputs)
            moved.append(tuple(dr.grad(x) for x in outputs))
        link = pack(at.hit.index, child.inward, depth + 1)
        return (*dr.detach(outputs), link), moved, child.active & (depth < edge.path.bounces)

    width = dr.width(ray)
    path = (*start(ray), pack(ray.source, ray.inward, dr.ones(type(ray.source), width)))
    dark = dr.zeros(type(ray.o), width)
    state: Any = path, [(o + dark, d + dark, dr.zeros(type(ray.o.x), width)) for o, d in slopes], edge.path.bounces > 0
    if reflects(scene):
        state = dr.while_loop(state, lambda *state: state[-1], bounce, mode="symbolic", label="level_jvp")
    results = []
    for slope in state[1]:
        inputs, moving, ray, _ = _moving(scene, tangents, state[0], slope)
        value, faint = level_function(moving, Arrival(ray, inputs[2]), edge.event, limits)
        column, row, _ = place(moving, ray, edge.event)
        outputs = value + faint * inputs[2], column, row
        push_forward(inputs)
        results.append((*(dr.grad(x) for x in outputs), slope[1]))
    return results, dr.detach(ray)


def _moving(scene: Scene, tangents: Parameters, path: tuple, slope: tuple) -> tuple:
    """Inputs of a node with their tangents, the scene and the ray that they make, and the node's depth."""
    o, d, weight, links = path
    still, depth = unpack(o, d, links)
    inputs = dr.detach((o, d, weight, scene.parameters(*tangents) if tangents else {}))
    dr.enable_grad(inputs)
    dr.set_grad(inputs, (*slope, dict(tangents)))
    o, d, weight, values = inputs
    return inputs, scene.carrying(values), Ray(o, d, still.source, still.inward), depth


@dataclass
class Adjoint:
    """What a traced ray returns to its parent (not frozen: Dr.Jit's loops write to their state)."""

    o: Array  # derivative by its origin
    d: Array  # and by its direction
    value: Array  # dot(seed, radiance), before the weight of its chain


def radiance_vjp(
    scene: Scene, sums: Parameters, wide: Parameters, ray: Ray, seed: Array, limits: Limits, moves: bool = True
) -> tuple:
    """The derivatives of dot(seed, radiance) along rays (reverse mode).

    Args:
        scene: with unit plane normals, and no gradients.
        sums: parameter name to derivatives so far, as wide as the wavefront.
        wide: parameter name to value, as wide as the wavefront, which keeps each lane's derivative in its lane.
        seed: Array3f, the adjoint of `trace.radiance`.
        moves: whether derivatives by the rays are of use.

    Returns:
        The sums with these rays' derivatives added, and the derivatives by the rays' origins and directions.
    """
    return _walk(_Tree(scene, wide, seed, limits, None if moves else _changed(scene, wide)), sums, ray)


def level_vjp(scene: Scene, sums: Parameters, wide: Parameters, ray: Ray, seed: Array, limits: Limits, edge: "Edge") -> tuple:
    """The derivatives of seed * (level function of an event at the end of a chain), like `radiance_vjp`."""
    return _walk(_Chain(scene, wide, seed, limits, None, edge), sums, ray)


def _changed(scene: Scene, names: Iterable[str]) -> tuple[int, ...] | None:
    """The primitives whose light, or that of their children, parameters of these names change by themselves; None if all."""
    spheres, changed = len(scene.spheres), set()
    for kind, position, field in (scene.locations[name] for name in names):
        if kind in ("spheres", "planes"):
            changed.add(position + (spheres if kind == "planes" else 0))
        elif kind == "materials":
            made = scene.materials[position].name
            changed |= {k for k in range(spheres + len(scene.planes)) if scene.material_of(k) == made}
            # An index counts for what lies inside, too
            changed |= {k for k, *_ in transparent(scene)} if field == "ior" else set()
        else:
            return None
    return tuple(changed) if len(changed) < spheres + len(scene.planes) else None


def _among(changed: tuple[int, ...] | None, hit: Hit, moves: Array) -> Array:
    """Whether what a ray meets changes its light: the ray moves, or the primitive is one of those that change."""
    for k in changed or ():
        moves |= hit.index == k
    return moves


def _walk(tree: "_Tree", sums: Parameters, ray: Ray) -> tuple:
    scene, limits = tree.scene, tree.limits

    def step(ray, weight, back, stack, sums, moves, tracing):
        state = ray, weight, back, stack, sums, moves
        state = dr.if_stmt(state, tracing, tree.arrive, lambda *state: (*state, dr.zeros(type(tracing), dr.width(weight))))
        returning = ~state[-1] & (state[3].size > 0)
        return dr.if_stmt(state, returning, tree.come_back, lambda *state: state)

    width = dr.width(ray)
    o, d, weight = start(ray)
    nothing, zero, uint = dr.zeros(type(o), width), dr.zeros(type(weight), width), type(ray.source)
    parts = o, d, o, d, zero, zero, zero, uint(0)
    stack = Stack.allocate(limits.max_depth if reflects(scene) else 0, dr.zeros(uint, width), *parts)
    ray, back = Ray(o, d, ray.source, ray.inward), Adjoint(nothing, nothing, zero)
    mask = type(ray.inward)
    state: Any = ray, weight, back, stack, dict(sums), dr.full(mask, tree.changed is None, width)
    if not reflects(scene):
        _, _, back, _, sums, *_ = tree.arrive(*state)
        return sums, back.o, back.d
    state = *state, dr.any(tree.seed != 0) & dr.ones(mask, width)
    state = dr.while_loop(state, lambda *s: s[-1] | (s[3].size > 0), step, mode="symbolic", label="radiance_vjp")
    return state[4], state[2].o, state[2].d


@dataclass(frozen=True)
class _Tree:
    """The two steps of a walk through a tree of rays in reverse mode.

    The stack holds the nodes between the camera and the ray that is being traced: ray, derivatives by it so far,
    distance, weight, light so far, and in one integer the primitive and what became of the node's children.

    A ray moves if something changes on the way to it. Light is differentiated only where a ray that moves arrives, or any
    at a primitive that changes; other light changes nothing.
    """

    scene: Scene
    wide: Parameters
    seed: Array
    limits: Limits
    changed: tuple[int, ...] | None  # the primitives that change by themselves; None if all, or if the first ray moves

    def attached(self, ray: Ray) -> tuple[Scene, Ray, dict[str, Array]]:
        """The scene, the ray and the parameters with fresh gradients."""
        values, o, d = dr.detach(dict(self.wide)), dr.detach(ray.o), dr.detach(ray.d)
        dr.enable_grad(values, o, d)
        return self.scene.carrying(values), Ray(o, d, ray.source, ray.inward), values

    def where(self, moves, differentiated, ray, hit, weight, sums, *more):
        """What a node adds to the adjoint of its ray and to the sums: nothing where the ray does not move."""

        inputs = ray, hit, weight, sums, *more
        if self.changed is None:
            return differentiated(*inputs)
        # Made out here: zeros that only a branch has made, Dr.Jit uses behind it
        dark = Adjoint(dr.zeros(type(ray.o)), dr.zeros(type(ray.d)), dr.zeros(type(weight)))
        yes, no = lambda dark, *inputs: differentiated(*inputs), lambda dark, ray, hit, weight, sums, *_: (dark, sums)
        return dr.if_stmt((dark, *inputs), moves, yes, no)

    def light(self, ray, hit, weight, sums):
        """The light of a surface itself."""
        moving, there, values = self.attached(ray)
        light = dr.dot(self.seed, emitted(moving, there, surface(moving, there, hit)))
        pull_back(light, weight)
        return Adjoint(dr.grad(there.o), dr.grad(there.d), dr.detach(light)), _added(sums, values)

    def through(self, ray, hit, weight, sums, first, back):
        """The light of a child."""
        moving, there, values = self.attached(ray)
        at = surface(moving, there, hit)
        branches = scatter(moving, there, at)
        child = choose(first, *branches) if len(branches) == 2 else branches[0]
        light = child.weight * (weight * back.value)
        pull_back(dr.dot(at.p, back.o) + dr.dot(child.direction, back.d) + light, dr.ones(type(weight)))
        return Adjoint(dr.grad(there.o), dr.grad(there.d), dr.detach(child.weight) * back.value), _added(sums, values)

    def arrive(self, ray, weight, back, stack, sums, moves):
        """Trace a ray: differentiate the light of its surface, then go on with its first child."""
        hit = closest_hit(self.scene, ray)
        moves = _among(self.changed, hit, moves)
        moving, there, _ = self.attached(ray)
        at = surface(moving, there, hit)
        branches = dr.detach(children(moving, there, at, weight, stack.size + 1, self.limits))
        back, sums = self.where(moves, self.light, ray, hit, weight, sums)
        if not branches:
            return ray, weight, back, stack, sums, moves, dr.zeros(type(ray.inward), dr.width(weight))
        child, first, both = branches[0], branches[0].active, type(ray.inward)(False)
        if len(branches) == 2:
            child, both = choose(first, *branches), first & branches[1].active
        links = hit.index | _bit(hit.inside, 16) | _bit(first, 17) | _bit(both, 18) | _bit(moves, 19)
        stack = stack.push(child.active, ray.o, ray.d, back.o, back.d, hit.t, weight, back.value, links)
        ray = Ray(dr.detach(at.p), child.direction, hit.index, child.inward)
        return ray, weight * child.weight, back, stack, sums, moves, child.active

    def come_back(self, ray, weight, back, stack, sums, moves, tracing):
        """Take a child's adjoints through its parent, then go on with the second child or return further."""
        parts = ray.o, ray.d, ray.o, ray.d, weight, weight, weight, ray.source
        stack, o, d, o_adjoint, d_adjoint, t, weight, value, links = stack.pop(type(tracing)(True), *parts)
        index, (inside, first, both, moves) = links & 0xFFFF, ((links & (1 << bit)) != 0 for bit in (16, 17, 18, 19))
        ray, hit = Ray(o, d, index, inside), Hit(t, index, inside)
        through, sums = self.where(moves, self.through, ray, hit, weight, sums, first, back)
        back = Adjoint(o_adjoint + through.o, d_adjoint + through.d, value + through.value)
        if branches_out(self.scene):
            moving, there, _ = self.attached(ray)
            at = surface(moving, there, hit)
            second = dr.detach(scatter(moving, there, at)[1])
            stack = stack.push(both, o, d, back.o, back.d, t, weight, back.value, index | _bit(inside, 16) | _bit(moves, 19))
            ray, weight = Ray(dr.detach(at.p), second.direction, index, second.inward), weight * second.weight
        return ray, weight, back, stack, sums, moves, both


@dataclass(frozen=True)
class Edge:
    """An event, and the path to its node."""

    path: Path
    event: Event


@dataclass(frozen=True)
class _Chain(_Tree):
    """A walk along one chain, to the level function at its end and back."""

    edge: Edge

    def arrive(self, ray, weight, back, stack, sums, moves):
        """Trace a ray: go on with the child that the path takes, and at its end differentiate the level function."""

        def onward(ray, weight, back, stack, sums, moves):
            hit = closest_hit(self.scene, ray)
            at = surface(self.scene, ray, hit)
            branches = children(self.scene, ray, at, weight, stack.size + 1, self.limits)
            child, first = take(branches, turn(self.edge.path, stack.size))
            links = hit.index | _bit(hit.inside, 16) | _bit(first, 17)
            nothing, zero = dr.zeros(type(ray.o), dr.width(weight)), dr.zeros(type(weight), dr.width(weight))
            stack = stack.push(child.active, ray.o, ray.d, nothing, nothing, hit.t, weight, zero, links)
            ray = Ray(at.p, child.direction, hit.index, child.inward)
            return ray, weight * child.weight, back, stack, sums, moves, child.active

        def end(ray, weight, back, stack, sums, moves):
            moving, there, values = self.attached(ray)
            value, faint = level_function(moving, Arrival(there, weight), self.edge.event, self.limits)
            pull_back(self.seed * (value + faint * weight), dr.ones(type(weight)))
            back = Adjoint(dr.grad(there.o), dr.grad(there.d), dr.detach(self.seed * faint))
            return ray, weight, back, stack, _added(sums, values), moves, dr.zeros(type(ray.inward), dr.width(weight))

        state = ray, weight, back, stack, sums, moves
        if not reflects(self.scene):
            return end(*state)
        return dr.if_stmt(state, stack.size < self.edge.path.bounces, onward, end)


def choose(condition: Array, a: Branch, b: Branch) -> Branch:
    """The first branch where the condition holds, else the second; active where either is."""
    weight, direction = dr.select(condition, a.weight, b.weight), dr.select(condition, a.direction, b.direction)
    return Branch(weight, direction, dr.select(condition, a.inward, b.inward), a.active | b.active)


def _added(sums: Parameters, values: Parameters) -> dict[str, Array]:
    return {name: sums[name] + dr.grad(values[name]) for name in sums}


def _bit(mask: Array, position: int) -> Array:
    return dr.select(mask, dr.uint32_array_t(mask)(1 << position), 0)
