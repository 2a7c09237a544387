"""The Whitted recursion: closest hit -> each light -> reflect and refract, down to a fixed depth.

    L(ray, depth) = emitted + w_r L(reflected, depth + 1) + w_t L(refracted, depth + 1)

The first levels of the binary tree of rays can be straight code, in which a packet of rays skips
the nodes that none of its rays needs. The rest is walked depth first by one loop with a small
stack, reflection before refraction. There a packet takes as many steps as the largest tree among
its rays has nodes, and a node is compiled once, whatever the depth. Scenes in which no material
both reflects and refracts get a chain, whose loop needs no stack, and scenes with neither a single
node without a loop.

How many levels are straight code:

| rays | levels | why |
|---|---|---|
| trees | 1 | an image takes 0 to 8 % less time, for 0.1 s more of compiling |
| chains | 3 | an image takes 4 to 6 % less time, for 0.15 s more; one level alone gains less |
| among spheres that a tree finds | 0 | nothing is gained, and a node compiles longer |

Each further level of a tree doubles its code and its compile time, and gains 1 to 2 % at most: five
levels compile for 2.3 to 2.8 s (two threads, AVX-512, LLVM 15; `whitted chart` measures a scene).
With edges it is the loop alone, in kernels that compile for seconds as it is.

Source: T. Whitted, "An Improved Illumination Model for Shaded Display", CACM 23(6), 1980.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import drjit as dr

from ..core.arrays import Array
from ..core.ray import Ray
from ..core.stack import Stack
from ..scene.features import branches_out, reflects
from ..scene.scene import Scene
from .node import Limits, Node, Visit, visit
from .shading import emitted

State = TypeVar("State")
# From a node and what has been found so far to what is found now, the node's children, and for each
# of them whether to go on with it
Step = Callable[[Any, State], tuple[State, list[Any], list[Array]]]


def radiance(
    scene: Scene, ray: Ray, limits: Limits, note: Callable[[Visit], None] | None = None
) -> Array:
    """Radiance along rays.

    Args:
        scene: with unit vectors for its directions, and no gradients (`autodiff` has those).
        ray: a wavefront of rays.
        limits: where the recursion ends.
        note: called with each node, once the light of its surface is known.

    Returns:
        Array3f, linear RGB.
    """

    def step(node: Node, light: Array) -> tuple[Array, list[Node], list[Array]]:
        seen = visit(scene, node, limits)
        light = dr.fma(node.weight, emitted(scene, node.ray, seen.at), light)
        if note is not None:
            note(seen)
        return light, seen.children, seen.traced

    dark = dr.zeros(type(ray.o), dr.width(ray))
    return walk(scene, limits, Node.first(scene, ray), dark, step, "radiance", limits.levels)


def walk(
    scene: Scene,
    limits: Limits,
    root: Any,
    state: State,
    step: Step,
    label: str,
    levels: int = 0,
    active: Array | None = None,
) -> State:
    """Walk through trees of nodes: the first levels, and then what is below them, depth first.

    Args:
        root: the first node, or any structure of arrays that stands for one.
        state: what has been found before the first node, as wide as the wavefront.
        step: called with each node.
        label: of the loop, for Dr.Jit.
        levels: of straight code; all that `limits` allow, or fewer.
        active: Bool: the rays to trace, if there is a loop, and no straight code [default: all].

    Returns:
        What has been found.
    """
    if not reflects(scene):
        return step(root, state)[0]

    def body(node, state, stack, active):
        state, children, onward = step(node, state)
        stack, active, node = _go_on(stack, onward, children)
        return node, state, stack, active

    width = dr.width(root)
    size = dr.zeros(type(limits.depth), width)
    capacity = limits.capacity if branches_out(scene) else 0
    node, active = root, dr.ones(dr.mask_t(size), width) if active is None else active
    if levels:
        # Below the straight levels of a chain there is one node
        below = max(capacity, 1) if limits.loops else 0
        state, stack = _straight(levels, step, node, state, Stack.allocate(below, size, root))
        if not limits.loops:
            return state
        active = stack.size > 0
        stack, node = stack.pop(active, node)
    if not (levels and capacity):
        stack = Stack.allocate(capacity, size, root)
    start = node, state, stack, active
    return dr.while_loop(start, lambda *s: s[-1], body, mode="symbolic", label=label)[1]


def _straight(
    levels: int, step: Step, node: Any, state: State, stack: Stack
) -> tuple[State, Stack]:
    """Some levels of a tree in straight code, and the stack with the nodes below them."""
    state, children, onward = step(node, state)
    both = list(zip(children, onward, strict=True))
    if levels == 1:
        # The first child is taken off first
        for child, active in reversed(both):
            stack = stack.push(active, child)
        return state, stack

    def deeper(child, state, stack):
        return child, *_straight(levels - 1, step, child, state, stack)

    for child, active in both:
        start = child, state, stack
        _, state, stack = dr.if_stmt(start, active, deeper, lambda *unchanged: unchanged)
    return state, stack


def _go_on(stack: Stack, active: list[Array], children: list[Any]) -> tuple[Stack, Array, Any]:
    """Go on with a node's first active child, or if it has none with the newest one on the stack.

    Returns:
        The stack, whether there is a node to go on with, and the node.
    """
    if len(children) == 1:
        return stack, active[0], children[0]
    first, second = active
    node = dr.select(first, *children)
    if not stack.slots:
        return stack, first | second, node
    stack = stack.push(first & second, children[1])
    more = ~first & ~second & (stack.size > 0)
    stack, node = stack.pop(more, node)
    return stack, first | second | more, node
