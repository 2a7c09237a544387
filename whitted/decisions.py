"""The discrete decisions at a node of the tree of rays, whose flips are the edges of the image.

A sample's label is a hash of the decisions at all nodes of its tree that weigh enough. The radiance of samples with one
label is one smooth function of the image position and the parameters; neighbours with different labels have an edge in
between.

Where weights change with the angle (Fresnel), a node may come to weigh enough between two neighbours without an edge.
Labels then have two halves, of nodes above one weight and above another: where an edge is, both differ.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

from .geometry import Array, Ray
from .optics import transmission
from .scene import PointLight, Scene
from .shading import blinn_phong, incident
from .surface import Surface, any_of, checkers, lookup, on_plane, relative_index

# Cells of a checkerboard between two samples beyond which their edges are left to the samples
CELLS = 4
# A highlight below this part of its light has no edge where it ends
GLINT = 1e-3


@dataclass(frozen=True)
class Decisions:
    index: Array  # UInt32: the primitive that was hit, or NONE
    inside: Array  # Bool: from within
    cell: tuple[Array, ...]  # Int: column and row of the checkerboard, nothing in a scene without one
    lights: tuple[Array, ...]  # Bool for each light: something keeps it away
    children: tuple[Array, ...]  # Bool for each child: it is traced
    total: tuple[Array, ...]  # Bool: internal reflection is total; nothing in a scene without glass


def decide(scene: Scene, ray: Ray, at: Surface, children: list[Array]) -> Decisions:
    """The decisions at a node, at which a ray arrives; its children are given as whether they are traced."""
    lights = tuple(_darkens(scene, ray, at, light) for light in scene.lights)
    return Decisions(at.hit.index, at.hit.inside, _cell(scene, at), lights, tuple(children), _total(scene, ray, at))


def _total(scene: Scene, ray: Ray, at: Surface) -> tuple[Array, ...]:
    if not any(scene.may(material, "refraction") for material in scene.used):
        return ()
    return (transmission(dr.fmax(-dr.dot(at.n, ray.d), 0), relative_index(scene, at))[1],)


def _cell(scene: Scene, at: Surface) -> tuple[Array, ...]:
    boards = checkers(scene)
    if not boards:
        return ()
    column = row = dr.int32_array_t(type(at.hit.t))(0)
    for k, plane, size in boards:
        u, v = on_plane(at.p, plane.normal)
        here = at.hit.index == k
        column = dr.select(here, type(column)(dr.floor(u / size)), column)
        row = dr.select(here, type(row)(dr.floor(v / size)), row)
    return column, row


def _darkens(scene: Scene, ray: Ray, at: Surface, light: PointLight) -> Array:
    """Whether something keeps a light away from a surface: a shadow, or the terminator where a highlight ends there."""
    seen = incident(scene, at, light)
    faces = at.hits & (seen.cosine > 0)
    shown = any_of(scene, at, lambda m: scene.may(m, "color") or scene.may(m, "specular") or m.checker is not None)
    dark = shown & faces & seen.blocked
    if any(scene.may(material, "specular") for material in scene.used):
        specular = lookup(scene, at, "specular", lambda m: scene.may(m, "specular"))
        shininess = lookup(scene, at, "shininess", lambda m: scene.may(m, "specular"))
        dark |= at.hits & ~faces & (specular * blinn_phong(ray.d, at.n, seen.direction, shininess) > GLINT)
    return dark


def flips(here: Decisions, there: Decisions) -> Array:
    """Whether a node decides differently for two rays, with an edge in between that can be found."""
    different = here.index != there.index
    for x, y in zip(_flags(here), _flags(there), strict=True):
        different |= x != y
    for x, y in zip(here.cell, there.cell, strict=True):
        different |= (x != y) & (dr.abs(x - y) <= CELLS)
    return different


def _flags(decisions: Decisions) -> tuple[Array, ...]:
    return decisions.inside, *decisions.children, *decisions.total, *decisions.lights


def mix(label: Array, decisions: Decisions) -> Array:
    """A label with the decisions of one more node hashed in (the mixing steps are MurmurHash3's, A. Appleby 2011)."""
    flags = _flags(decisions)
    words = [decisions.index, *(type(label)(cell) for cell in decisions.cell)]
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


def differ(a: Array, b: Array) -> Array:
    """Whether an edge is between samples with these labels (arrays of Dr.Jit or of NumPy)."""
    size = a.itemsize if isinstance(a, np.ndarray) else dr.itemsize_v(a)
    if size == 4:
        return a != b
    both = a ^ b
    return ((both & 0xFFFFFFFF) != 0) & ((both >> 32) != 0)
