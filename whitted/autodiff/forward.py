"""Forward mode: each ray carries its tangent down the tree of rays.

A node is a small function of its ray and the scene, and a tree of nodes is the chain rule. No
intermediate image is stored, whatever the depth.
"""

from dataclasses import dataclass

import drjit as dr

from ..core.arrays import Array, Parameters
from ..core.ray import Ray
from ..scene.scene import Scene
from ..tracing.intersect import closest_hit
from ..tracing.node import Limits, Node, visit
from ..tracing.recursion import walk
from ..tracing.shading import emitted
from ..tracing.surface import surface
from .changed import changed
from .propagate import push_forward


@dataclass
class Tangent:
    """The tangents of a node (not frozen: Dr.Jit's loops write to their state)."""

    o: Array
    d: Array
    weight: Array

    @staticmethod
    def first(node: Node, o: Array, d: Array) -> "Tangent":
        """The tangents of a first node, from those of its rays' origins and directions."""
        nothing = dr.zeros(type(node.o), dr.width(node))
        return Tangent(o + nothing, d + nothing, dr.zeros(type(node.weight), dr.width(node)))

    @staticmethod
    def of(node: Node) -> "Tangent":
        """The tangents that forward mode has brought to a node."""
        return Tangent(dr.grad(node.o), dr.grad(node.d), dr.grad(node.weight))


@dataclass
class Moving:
    """A node and its tangents (not frozen: Dr.Jit's loops write to their state)."""

    node: Node
    tangent: Tangent


def attached(
    scene: Scene, tangents: Parameters, node: Node, tangent: Tangent
) -> tuple[object, Scene, Node]:
    """Inputs with fresh tangents, and the scene and the node that are made of them."""
    values = scene.parameters(*tangents) if tangents else {}
    inputs = dr.detach((node.o, node.d, node.weight, values))
    dr.enable_grad(inputs)
    dr.set_grad(inputs, (tangent.o, tangent.d, tangent.weight, dict(tangents)))
    o, d, weight, values = inputs
    there, rows = scene.carrying(values), []
    if scene.gathered is not None:
        gathered = scene.gathered.anew()
        there, rows = there.gathering(gathered), gathered.rows
    return (inputs, rows), there, Node(o, d, weight, node.link)


def radiance_jvp(
    scene: Scene, tangents: Parameters, ray: Ray, o_slope: Array, d_slope: Array, limits: Limits
) -> Array:
    """The derivative of radiance along rays, in one direction of parameter space.

    Args:
        scene: with unit vectors for its directions, and no gradients.
        tangents: parameter name to tangent, of width 1; those of other parameters are 0.
        o_slope, d_slope: tangents of the rays' origins and directions.

    Returns:
        Array3f, the tangent of `recursion.radiance`.
    """
    these = changed(scene, tangents)
    first = Node.first(scene, ray)
    dark = dr.zeros(type(ray.o), dr.width(first))

    def light(dark, moving, hit):
        inputs, there, node = attached(scene, tangents, moving.node, moving.tangent)
        value = node.weight * emitted(there, node.ray, surface(there, node.ray, hit))
        push_forward(inputs)
        return dr.grad(value)

    def step(moving, result):
        tangent = moving.tangent
        inputs, there, node = attached(scene, tangents, moving.node, tangent)
        hit = closest_hit(scene, dr.detach(node.ray))
        if these is None:
            result += light(dark, moving, hit)
        else:
            moves = dr.any(tangent.o != 0) | dr.any(tangent.d != 0) | (tangent.weight != 0)
            moves |= these.among(scene, hit.index)
            result += dr.if_stmt((dark, moving, hit), moves, light, lambda dark, *_: dark)
        seen = visit(there, node, limits, hit)
        children = seen.children
        push_forward(inputs)
        onward = [Moving(dr.detach(child), Tangent.of(child)) for child in children]
        return result, onward, dr.detach(seen.traced)

    root = Moving(first, Tangent.first(first, o_slope, d_slope))
    return walk(scene, limits, root, dark, step, "radiance_jvp")
