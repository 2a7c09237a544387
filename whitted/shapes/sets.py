"""The primitives of a scene, by kind. Here, and nowhere else, a primitive is one Python object.

Primitives are numbered over the whole scene. Each kind of shape forms a set, whose primitives have
consecutive numbers; on equal distance the smaller number wins. A set searches, and then hands out
one primitive a lane (`Picked`), on which the rest of the tracer works, however many primitives
there are.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import drjit as dr

from ..core.arrays import Array, any_true, select
from ..core.parameter import POSITIVE, Parameter, parameters_of
from ..core.ray import NONE, Ray, ShadowRay
from .places import Places
from .shape import Shape
from .sphere import Sphere


@dataclass
class Hit:
    """The nearest primitive along a ray (not frozen: Dr.Jit's loops write to their state)."""

    t: Array  # distance, infinite for a ray that leaves the scene
    index: Array  # UInt32: number of the primitive, or NONE
    inside: Array  # Bool: the ray travelled in the primitive that it hit
    # UInt32: a bit for each light that something keeps away, where that is known already
    shadows: Array | None = None

    @staticmethod
    def none(like: Array, with_shadows: bool = False) -> "Hit":
        """Of rays that leave the scene, as many as a real array has lanes."""
        width, uint = dr.width(like), dr.uint32_array_t(like)
        t, number = dr.full(type(like), dr.inf, width), dr.full(uint, NONE, width)
        shadows = dr.zeros(uint, width) if with_shadows else None
        return Hit(t, number, dr.full(dr.mask_t(like), False, width), shadows)


def nearer(
    hit: Hit, number: Array, shape: Shape, met: tuple[Array, Array, Array], ordered: bool = True
) -> Hit:
    """A hit, or where a ray meets a primitive if that is nearer.

    Args:
        met: what the primitive's `distance` has found.
        ordered: primitives come in the order of their numbers, so that the first one stays.
    """
    distance, meets, within = met
    closer = distance < hit.t
    if not ordered:
        closer |= (distance == hit.t) & (number < hit.index)
    closer &= meets
    inside = dr.select(closer, within, hit.inside) if shape.closed else hit.inside & ~closer
    t, index = dr.select(closer, distance, hit.t), dr.select(closer, number, hit.index)
    return Hit(t, index, inside)


@dataclass
class Medium:
    """What fills space around a point: the smallest transparent primitive that contains it."""

    ior: Array
    extent: Array  # the primitive's size, infinite where nothing fills
    index: Array  # UInt32: the primitive's number, or NONE


@dataclass(frozen=True)
class ShapeSet:
    """Primitives of one kind, each of which is code of its own in a kernel."""

    kind: type[Shape]
    first: int  # number of the first primitive
    members: tuple[tuple[int, Shape], ...]  # those that can be met, by number

    @property
    def made_from(self) -> frozenset[str]:
        """The names of the materials of the set's primitives."""
        return frozenset(shape.material for _, shape in self.members)

    def pick(self, index: Array, color: Any) -> Shape:
        """The primitive of this number, one a lane; some legal one in lanes of another number.

        Args:
            color: any colour, whose types are taken.
        """
        fields = {}
        for field, entry in parameters_of(self.kind).items():
            table = ((number, getattr(shape, field)) for number, shape in self.members)
            fields[field] = select(index, table, _blank(entry, color))
        picked: Any = self.kind("", "", **fields)
        careful = any(shape.compensated for _, shape in self.members)
        on = [index == number for number, shape in self.members if shape.under_eye]
        return _flagged(picked, careful, any_true(on, on[0]) if on else False)

    def closest(self, ray: Ray, hit: Hit) -> Hit:
        """The nearest primitive along a ray, where it is nearer than a hit."""
        for number, shape in self.members:
            hit = self._nearer(number, shape, ray, hit)
        return hit

    def _nearer(self, number: int, shape: Shape, ray: Ray, hit: Hit) -> Hit:
        """Where a ray meets one primitive, if that is nearer than a hit.

        Few rays come near a sphere, so a branch skips its roots for packets in which none does.
        """
        on = ray.source == number
        near, known = shape.approach(ray, on)

        def search(hit: Hit) -> Hit:
            return nearer(hit, number, shape, shape.distance(ray, on, *known))

        return search(hit) if near is None else dr.if_stmt((hit,), near, search, lambda hit: hit)

    def blocked(self, ray: ShadowRay, materials: Collection[str]) -> Array:
        """Bool: some primitive of these materials crosses the segment to a light."""
        masks = (crosses for _, _, crosses in self._crossed(ray, materials))
        return any_true(masks, ray.inward)

    def transmitted(
        self, ray: ShadowRay, passes: dict[str, Array], light: Array, veil: Array
    ) -> tuple[Array, Array]:
        """What is left of a light behind primitives that keep only a part of it away.

        Args:
            passes: material to the part of the light that passes each primitive of it.
            light, veil: what is left so far, and a hash of the primitives that were crossed.
        """
        for number, material, crosses in self._crossed(ray, passes):
            light = light * dr.select(crosses, passes[material], 1)
            veil = veil ^ dr.select(crosses, type(veil)(scattered(number)), 0)
        return light, veil

    def flipped(
        self, a: ShadowRay, b: ShadowRay, materials: Collection[str], best: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """The primitive that crosses one of two segments to a light, and nearly crosses the other.

        Args:
            best: the number of the best primitive so far, and its outline's level for the segment
                that it does not cross.
        """
        if not self.kind.casts_edges:
            return best
        other, nearest = best
        for number, shape in self.members:
            if shape.material in materials:
                here, there = (
                    shape.blocks(ray, ray.source == number, number in ray.ends_on) for ray in (a, b)
                )
                gap = shape.outline(dr.select(here, b.o, a.o), dr.select(here, b.d, a.d))
                better = (here ^ there) & (gap > nearest)
                other, nearest = dr.select(better, number, other), dr.select(better, gap, nearest)
        return other, nearest

    def innermost(
        self, p: Array, but: Array, medium: Medium, fills: dict[str, tuple[Array, Array]]
    ) -> Medium:
        """The smallest transparent primitive that contains a point, if it is smaller than a medium.

        Args:
            but: UInt32, the number of a primitive that does not count.
            fills: material to its index of refraction, and Bool: it is transparent.
        """
        for number, shape in self.members:
            if self.kind.closed and shape.material in fills:
                (ior, clear), extent = fills[shape.material], shape.extent()
                around = (shape.level(p) < 0) & (but != number) & clear & (extent < medium.extent)
                medium = Medium(
                    dr.select(around, ior, medium.ior),
                    dr.select(around, extent, medium.extent),
                    dr.select(around, number, medium.index),
                )
        return medium

    def materials(self, index: Array) -> dict[str, Array]:
        """Material to Bool: the primitive of this number is made of it."""
        made: dict[str, Array] = {}
        for number, shape in self.members:
            here = index == number
            made[shape.material] = made[shape.material] | here if shape.material in made else here
        return made

    def made_of(self, materials: Collection[str]) -> int:
        """How many primitives are made of one of these materials."""
        return sum(shape.material in materials for _, shape in self.members)

    def named(self, index: Array, names: Collection[str]) -> Array:
        """Bool: the primitive of this number has one of these names."""
        masks = (index == number for number, shape in self.members if shape.name in names)
        return any_true(masks, index == NONE)

    def _crossed(
        self, ray: ShadowRay, materials: Collection[str]
    ) -> Iterator[tuple[int, str, Array]]:
        """Number and material of each primitive of some materials, and Bool: it is crossed."""
        for number, shape in self.members:
            if shape.material in materials:
                crosses = shape.blocks(ray, ray.source == number, number in ray.ends_on)
                yield number, shape.material, crosses


def sets_of(shapes: Sequence[Shape], places: Places) -> tuple[ShapeSet, ...]:
    """The sets of some shapes; at least one, which may be empty.

    Args:
        shapes: by kind, in the order of `SHAPES`.
    """
    sets = []
    for kind, members in groupby(enumerate(shapes), lambda member: type(member[1])):
        own = list(members)
        met = tuple(
            (number, _flagged(shape, number in places.compensated, number in places.under_eye))
            for number, shape in own
            if number not in places.hidden
        )
        sets.append(ShapeSet(kind, own[0][0], met))
    return tuple(sets) or (ShapeSet(Sphere, 0, ()),)


def _flagged(shape: Any, compensated: bool, under_eye: Array | bool) -> Any:
    """A shape as kernels compute it."""
    return replace(shape, compensated=compensated, under_eye=under_eye)


def _blank(entry: Parameter, color: Any) -> Array:
    """A value of a parameter that is legal for every shape."""
    if entry.legal.direction:
        return type(color)(0, 1, 0)
    kind = type(color) if entry.size == 3 else dr.value_t(color)
    return kind(1 if entry.legal is POSITIVE else 0)


def scattered(number: Any) -> Any:
    """A hash of a number (D. Knuth's multiplier)."""
    return (number + 1) * 0x9E3779B1 & 0xFFFFFFFF


@dataclass(frozen=True)
class Picked:
    """One primitive a lane, of any kind."""

    # For each kind in turn: Bool, the lane's kind is this one or a later one; and the primitives
    parts: Sequence[tuple[Array, Shape]]

    def of(self, function: Callable[[Any], Any]) -> Any:
        """A function of the lane's own shape; in lanes without one, of a blank shape."""
        (_, shape), *others = self.parts
        result = function(shape)
        for here, shape in others:
            result = dr.select(here, function(shape), result)
        return result

    def whether(self, flag: Callable[[type[Shape]], bool]) -> Array | bool:
        """Bool: the lane's own kind has a property; a plain bool where all kinds agree."""
        flags = [flag(type(shape)) for _, shape in self.parts]
        if len(set(flags)) == 1:
            return flags[0]
        result = type(self.parts[0][0])(flags[0])
        for (here, _), own in zip(self.parts[1:], flags[1:], strict=True):
            result = result | here if own else result & ~here
        return result


def pick(sets: Sequence[ShapeSet], index: Array, color: Any) -> Picked:
    """The primitives of these numbers. `color` is any colour, whose types are taken."""
    return Picked([(index >= one.first, one.pick(index, color)) for one in sets])
