"""The discrete decisions at a node of the tree of rays, whose flips are the edges of the image.

A sample's label is a hash of the decisions at all nodes of its tree that weigh enough. The radiance
of samples with one label is one smooth function of the image position and the parameters;
neighbours with different labels have an edge in between.

Where weights change with the angle (Fresnel), a node may come to weigh enough between two
neighbours without an edge. Labels then have two halves, of nodes above one weight and above
another: where an edge is, both differ.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array
from ..core.ray import Ray
from ..scene.features import bends, glossy, may, weights_vary
from ..scene.scene import Scene
from ..tracing.media import relative_index
from ..tracing.node import Limits, Node, Visit, visit
from ..tracing.optics import transmission
from ..tracing.recursion import Step, walk
from ..tracing.shading import blinn_phong, emitted, highlight
from ..tracing.shadow import Incident, incident
from ..tracing.surface import Surface, any_of, boards
from .settings import CELLS, LEAST_HIGHLIGHT

# A label before it is joined: one or two UInt32
Halves = tuple[Array, ...]


@dataclass(frozen=True)
class Decisions:
    """What a node decides."""

    index: Array  # UInt32: the primitive that was hit, or NONE
    inside: Array  # Bool: from within
    cell: tuple[Array, ...]  # Int: column and row of the checkerboard; empty in a scene without one
    lights: tuple[Array, ...]  # Bool for each light: something keeps it away
    # UInt32 for each light: a hash of what dims it; empty where all shadows are full
    veils: tuple[Array, ...]
    children: tuple[Array, ...]  # Bool for each child: it is traced
    # Bool: all light is reflected, none refracted; empty in a scene without glass or polish
    total: tuple[Array, ...]

    @property
    def flags(self) -> tuple[Array, ...]:
        return self.inside, *self.children, *self.total, *self.lights


def decide(scene: Scene, seen: Visit, all_sides: bool = False) -> Decisions:
    """The decisions at a node.

    Args:
        all_sides: of `incident`, for what follows. No decision depends on it.
    """
    ray, at = seen.node.ray, seen.at
    incidents = [incident(scene, at, k, all_sides) for k in range(len(scene.lights))]
    return Decisions(
        index=at.hit.index,
        inside=at.hit.inside,
        cell=_cell(scene, at),
        lights=tuple(_is_dark(scene, ray, at, light) for light in incidents),
        veils=tuple(
            dr.select(_shows_light(scene, at) & (light.cosine > 0) & ~light.dark, light.veil, 0)
            for light in incidents
            if light.veil is not None
        ),
        children=tuple(seen.traced),
        total=_total(scene, ray, at),
    )


def cos_theta_t_squared(scene: Scene, ray: Ray, at: Surface) -> tuple[Array, Array]:
    """The square of the refracted ray's cosine, and Bool: reflection is total."""
    return transmission(dr.fmax(-dr.dot(at.n, ray.d), 0), relative_index(scene, at))


def _total(scene: Scene, ray: Ray, at: Surface) -> tuple[Array, ...]:
    return (cos_theta_t_squared(scene, ray, at)[1],) if bends(scene) else ()


def _cell(scene: Scene, at: Surface) -> tuple[Array, ...]:
    known = boards(scene)
    column = row = dr.int32_array_t(at.hit.t)(0)
    for material, board in known.items():
        here, cell = at.of[material], board.cell(at.p, at.n)
        column, row = (
            dr.select(here, type(old)(new), old)
            for old, new in zip((column, row), cell, strict=True)
        )
    return (column, row) if known else ()


def _shows_light(scene: Scene, at: Surface) -> Array:
    """Bool: light that falls on the surface can be seen."""

    def shows(m):
        return may(scene, m, "color") or may(scene, m, "specular") or m.checker is not None

    return at.hits & any_of(scene, at, shows)


def _is_dark(scene: Scene, ray: Ray, at: Surface, light: Incident) -> Array:
    """Bool: a light is kept away, by a shadow, or by the terminator if a highlight ends there."""
    faces = at.hits & (light.cosine > 0)
    dark = _shows_light(scene, at) & faces & light.dark
    if glossy(scene):
        specular, shininess = highlight(scene, at)
        shine = specular * blinn_phong(ray.d, at.n, light.toward, light.cosine, shininess)
        dark |= at.hits & ~faces & (shine > LEAST_HIGHLIGHT)
    return dark


def decisions_differ(here: Decisions, there: Decisions) -> Array:
    """Bool: a node decides differently for two rays, so that an edge between can be found."""
    different = here.index != there.index
    for x, y in zip(here.flags, there.flags, strict=True):
        different |= x != y
    for x, y in zip(here.veils, there.veils, strict=True):
        different |= x != y
    for x, y in zip(here.cell, there.cell, strict=True):
        different |= (x != y) & (dr.abs(x - y) <= CELLS)
    return different


def least_weights(scene: Scene, limits: Limits) -> Halves:
    """The least products of weights of the nodes that count for a label, or for each half of it."""
    return (limits.faint, limits.faint / 2) if weights_vary(scene) else (limits.faint,)


def first_label(scene: Scene, limits: Limits, width: int) -> Halves:
    """The halves of a label before the first node."""
    halves = range(len(least_weights(scene, limits)))
    return tuple(dr.full(type(limits.depth), 1 + half, width) for half in halves)


def with_node(scene: Scene, seen: Visit, label: Halves, limits: Limits) -> Halves:
    """The label's halves with the decisions of one more node."""
    decided, weight = decide(scene, seen), dr.abs(seen.node.weight)
    pairs = zip(least_weights(scene, limits), label, strict=True)
    return tuple(dr.select(weight >= least, _mix(half, decided), half) for least, half in pairs)


def heavy(seen: Visit, least: Array | None) -> list[Array]:
    """For each child of a node, Bool: it is traced, and weighs enough."""
    if least is None:
        return seen.traced
    weight = seen.node.weight
    return [b.active & (dr.abs(weight * b.weight) >= least) for b in seen.branches]


def labelled_radiance(
    scene: Scene,
    ray: Ray,
    limits: Limits,
    least: Array | None = None,
    levels: int = 0,
    note: Callable[[Visit], None] | None = None,
) -> tuple[Array, Array]:
    """Radiance along rays, and the labels of their trees.

    Args:
        least: the least weight of the nodes whose light counts; below that of those in labels.
        levels: of straight code, as in `walk`.
        note: as that of `recursion.radiance`.
    """

    def step(node: Node, state: tuple[Array, Halves]) -> tuple:
        seen = visit(scene, node, limits)
        light, label = state
        label = with_node(scene, seen, label, limits)
        light = dr.fma(node.weight, emitted(scene, node.ray, seen.at), light)
        if note is not None:
            note(seen)
        return (light, label), seen.children, heavy(seen, least)

    dark = dr.zeros(type(ray.o), dr.width(ray))
    return _labelled(scene, ray, limits, dark, step, levels)


def labelled_in_parts(
    scene: Scene,
    ray: Ray,
    limits: Limits,
    least: Array,
    levels: int,
    note: Callable[[Visit], None] | None,
) -> tuple[Array, Array, Array]:
    """Radiance along rays, the part of it from nodes that weigh less than `least`, and labels.

    Args:
        levels, note: as those of `labelled_radiance`.
    """

    def step(node: Node, state: tuple[tuple[Array, Array], Halves]) -> tuple:
        seen = visit(scene, node, limits)
        (light, dim), label = state
        label, own = with_node(scene, seen, label, limits), emitted(scene, node.ray, seen.at)
        dim = dr.fma(dr.select(dr.abs(node.weight) < least, node.weight, 0), own, dim)
        light = dr.fma(node.weight, own, light)
        if note is not None:
            note(seen)
        return ((light, dim), label), seen.children, seen.traced

    dark = dr.zeros(type(ray.o), dr.width(ray))
    light, label = _labelled(scene, ray, limits, (dark, dark + 0), step, levels)
    return *light, label


def _labelled(
    scene: Scene, ray: Ray, limits: Limits, dark: Any, step: Step, levels: int
) -> tuple[Any, Array]:
    """What a walk finds that begins in the dark, and labels."""
    state = dark, first_label(scene, limits, dr.width(ray))
    root = Node.first(scene, ray)
    light, label = walk(scene, limits, root, state, step, "labelled_radiance", levels)
    return light, joined(label)


def _mix(label: Array, decisions: Decisions) -> Array:
    """A label with the decisions of one more node.

    Source: the steps of MurmurHash3, A. Appleby, 2011.
    """
    flags = decisions.flags
    words = [decisions.index, *(type(label)(cell) for cell in decisions.cell), *decisions.veils]
    for first in range(0, len(flags), 32):
        word = type(label)(0)
        for bit, flag in enumerate(flags[first : first + 32]):
            word |= dr.select(flag, type(label)(1 << bit), 0)
        words.append(word)
    for word in words:
        word = word * 0xCC9E2D51
        word = ((word << 15) | (word >> 17)) * 0x1B873593
        label = label ^ word
        label = ((label << 13) | (label >> 19)) * 5 + 0xE6546B64
    return label


def joined(halves: Sequence[Array]) -> Array:
    """A label of one half, UInt32, or of two, UInt64."""
    if len(halves) == 1:
        return halves[0]
    long: Any = dr.uint64_array_t(type(halves[0]))
    return long(halves[0]) | (long(halves[1]) << 32)


def labels_differ(a: Array, b: Array) -> Array:
    """Bool: an edge is between samples with these labels (arrays of Dr.Jit or of NumPy)."""
    size = a.itemsize if isinstance(a, np.ndarray) else dr.itemsize_v(a)
    if size == 4:
        return a != b
    both = a ^ b
    return ((both & 0xFFFFFFFF) != 0) & ((both >> 32) != 0)
