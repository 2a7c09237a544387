"""How edges move: derivatives of level functions along the chain of rays to an event's node."""

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr

from ..autodiff.forward import Direction, RaySlopes, Tangent, attached
from ..autodiff.propagate import pull_back, push_forward
from ..autodiff.reverse import Adjoint, Place, Tree, Waiting, added, walk_back
from ..core.arrays import Array, Parameters
from ..core.ray import Ray
from ..scene.features import reflects
from ..scene.scene import Scene
from ..tracing.node import FIRST, Limits, Node, visit
from ..tracing.record import Hits, hit_of
from .events import Event, board_place, level_function
from .paths import Path


@dataclass
class Edge:
    """An event, and the path to its node (not frozen: Dr.Jit's loops write to their state)."""

    path: Path
    event: Event


@dataclass(frozen=True)
class Slope:
    """Derivatives at the end of a chain, in one direction."""

    level: Array  # of the level function
    column: Array  # of the place on a checkerboard, in cells
    row: Array
    turn: Array  # of the direction of the ray that arrives


def level_jvp(
    directions: Sequence[Direction],
    ray: Ray,
    slopes: RaySlopes,
    limits: Limits,
    edge: Edge,
    hits: Hits | None,
) -> tuple[list[Slope], Ray]:
    """The derivatives of an event's level function in some directions, as `radiance_jvp`.

    Args:
        hits: on the way to the event's node, where they are known.

    Returns:
        The derivatives in each direction, and the ray that arrives at the event's node.
    """
    scene = directions[0].scene
    first = Node.first(scene, ray)
    state = first, [Tangent.first(first, o, d) for o, d in slopes], edge.path.bounces > 0

    def bounce(node, ahead, active):
        following, hit = [], hit_of(node, hits)
        for direction, tangent in zip(directions, ahead, strict=True):
            inputs, there, moving = attached(direction, node, tangent)
            seen = visit(there, moving, limits, hit)
            branch, _ = edge.path.onward(seen)
            child = seen.child(branch)
            push_forward(inputs)
            following.append(Tangent.of(child))
        goes_on = dr.detach(branch.active) & (node.depth < edge.path.bounces)
        return dr.detach(child), following, goes_on

    if reflects(scene):
        state = dr.while_loop(state, lambda *s: s[-1], bounce, mode="symbolic", label="level_jvp")
    node, ahead, _ = state
    results = []
    for direction, tangent in zip(directions, ahead, strict=True):
        inputs, there, moving = attached(direction, node, tangent)
        value, faint = level_function(there, moving, edge.event, limits)
        column, row, _ = board_place(there, moving.ray, edge.event)
        level = value + faint * moving.weight
        push_forward(inputs)
        results.append(Slope(dr.grad(level), dr.grad(column), dr.grad(row), tangent.d))
    return results, dr.detach(moving.ray)


def level_vjp(
    scene: Scene,
    sums: Parameters,
    wide: Parameters,
    ray: Ray,
    seed: Array,
    limits: Limits,
    edge: Edge,
    hits: Hits | None,
) -> tuple[dict[str, Array], Array, Array]:
    """The derivatives of seed * (an event's level function), in reverse mode, as `radiance_vjp`.

    Args:
        hits: of `level_jvp`.
    """
    return walk_back(_Chain(scene, wide, seed, limits, None, hits, edge), sums, ray)


@dataclass(frozen=True)
class _Chain(Tree):
    """A walk along one chain, to the level function at its end and back."""

    edge: Edge

    def arrive(self, place, stack, sums):
        """Trace a ray: go on along the path, or differentiate the level function at its end."""
        if not reflects(self.scene):
            return self.end(place, stack, sums)
        return dr.if_stmt(
            (place, stack, sums), stack.size < self.edge.path.bounces, self.onward, self.end
        )

    def onward(self, place, stack, sums):
        node = place.node
        seen = visit(self.scene, node, self.limits, hit_of(node, self.hits))
        hit = seen.at.hit
        branch, first = self.edge.path.onward(seen)
        link = node.link.of(hit.index, hit.inside, node.depth).marked(FIRST, first)
        waiting = Waiting(
            Node(node.o, node.d, node.weight, link), Adjoint.zero(node, dr.width(node)), hit.t
        )
        stack = stack.push(branch.active, waiting)
        return Place(seen.child(branch), place.back, place.moves), stack, sums, branch.active

    def end(self, place, stack, sums):
        scene, there, values = self.attached(place.node)
        value, faint = level_function(scene, there, self.edge.event, self.limits)
        weight = place.node.weight
        pull_back(self.seed * (value + faint * weight), dr.ones(type(weight)))
        back = Adjoint(dr.grad(there.o), dr.grad(there.d), dr.detach(self.seed * faint))
        none = dr.zeros(type(place.moves), dr.width(weight))
        return Place(place.node, back, place.moves), stack, added(sums, values, scene), none
