"""Many spheres, found by a tree: one kernel for every number of them."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr

from ..core.arrays import Array, any_true, precision_of
from ..core.gathered import Gathered
from ..core.ray import Ray, ShadowRay
from .places import PlacesOfMany
from .sets import Hit, Medium, nearer, scattered
from .shape import Shape
from .sphere import Sphere
from .traversal import Line, TreeNode, nearest, walk_nodes

# The number of the first of them: above those of all other primitives, and above NONE
FIRST = 0x10000
# What stands for all of them among the names of shapes that change
NAME = "many"


@dataclass(frozen=True)
class ManySpheres:
    """Spheres in a tree; it does what `ShapeSet` does for primitives that are code of their own."""

    kind = Sphere
    first = FIRST

    materials_by_number: tuple[str, ...]
    count: int
    places: PlacesOfMany
    spheres: Array  # (count, 4), flat: centers and radii
    nodes: Array  # of `hierarchy.py`, flat
    material: Array  # UInt32: the number of each sphere's material
    # UInt32: a bit for the eye, and one for each light of `places`, that is exactly on the sphere
    special: Array
    # Where derivatives are taken by the spheres
    gathered: Gathered | None = None

    @property
    def made_from(self) -> frozenset[str]:
        """The names of the materials."""
        return frozenset(self.materials_by_number)

    def pick(self, index: Array, color: Any) -> Shape:
        """The sphere of this number, one a lane; some legal one in lanes of another number."""
        here, place = index >= FIRST, index - FIRST
        row = dr.gather(precision_of(self.spheres).vector4, dr.detach(self.spheres), place, here)
        if self.gathered is not None:
            row = self.gathered.attach(row, place, here)
        eye = self._marked(index, 0) if self.places.under_eye else False
        center, radius = type(color)(row.x, row.y, row.z), dr.select(here, row.w, 1)
        return Sphere("", "", center, radius, compensated=self.places.compensated, under_eye=eye)

    def closest(self, ray: Ray, hit: Hit) -> Hit:
        """The nearest sphere along a ray, where it is nearer than a hit."""

        def look(node: TreeNode, hit: Hit) -> Hit:
            number = node.number + FIRST
            sphere = self._sphere(node, number)
            on = ray.source == number
            near, known = sphere.approach(ray, on)

            def meet(hit: Hit) -> Hit:
                met = sphere.distance(ray, on, *known)
                return nearer(hit, number, sphere, met, ordered=False)

            return dr.if_stmt((hit,), near & node.is_leaf, meet, lambda hit: hit)

        return nearest(self.nodes, Line.of(ray.o, ray.d), hit, lambda hit: hit.t, look)

    def blocked(self, ray: ShadowRay, materials: Collection[str]) -> Array:
        """Bool: some sphere of these materials crosses the segment to a light."""

        def cross(sphere: Sphere, number: Array, blocked: Array) -> Array:
            return blocked | self._crosses(sphere, number, ray, materials)

        return self._along(ray, materials, ray.inward & False, cross, lambda blocked: blocked)

    def transmitted(
        self, ray: ShadowRay, passes: dict[str, Array], light: Array, veil: Array
    ) -> tuple[Array, Array]:
        """As that of `ShapeSet`."""

        def cross(sphere: Sphere, number: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
            light, veil = state
            crosses = self._crosses(sphere, number, ray, passes)
            for name, part in passes.items():
                here = self.materials(number).get(name, False)
                light = light * dr.select(crosses & here, part, 1)
            return light, veil ^ dr.select(crosses, scattered(number), 0)

        return self._along(ray, passes, (light, veil), cross)

    def flipped(
        self, a: ShadowRay, b: ShadowRay, materials: Collection[str], best: tuple[Array, Array]
    ) -> tuple[Array, Array]:
        """As that of `ShapeSet`."""

        def cross(sphere: Sphere, number: Array, best: tuple[Array, Array]) -> tuple[Array, Array]:
            other, largest = best
            here, there = (self._crosses(sphere, number, ray, materials) for ray in (a, b))
            gap = sphere.outline(dr.select(here, b.o, a.o), dr.select(here, b.d, a.d))
            better = (here ^ there) & ((gap > largest) | ((gap == largest) & (number < other)))
            return dr.select(better, number, other), dr.select(better, gap, largest)

        one, two = Line.of(a.o, a.d), Line.of(b.o, b.d)

        def enters(node: TreeNode, best: tuple[Array, Array]) -> Array:
            return one.enters(node, a.distance)[1] | two.enters(node, b.distance)[1]

        return self._walk(materials, best, a.wanted | b.wanted, enters, cross)

    def innermost(
        self, p: Array, but: Array, medium: Medium, fills: dict[str, tuple[Array, Array]]
    ) -> Medium:
        """As that of `ShapeSet`."""

        def contain(sphere: Sphere, number: Array, medium: Medium) -> Medium:
            extent, of = sphere.extent(), self.materials(number)
            smaller = (extent < medium.extent) | (
                (extent == medium.extent) & (number < medium.index)
            )
            around = (sphere.level(p) < 0) & (but != number) & smaller
            for name, (ior, clear) in fills.items():
                here = around & of.get(name, False) & clear
                medium = Medium(
                    dr.select(here, ior, medium.ior),
                    dr.select(here, extent, medium.extent),
                    dr.select(here, number, medium.index),
                )
            return medium

        everywhere = dr.mask_t(p.x)(True)
        return self._walk(fills, medium, everywhere, lambda node, _: node.holds(p), contain)

    def materials(self, index: Array) -> dict[str, Array]:
        """Material to Bool: the sphere of this number is made of it."""
        here = index >= FIRST
        if len(self.materials_by_number) == 1:
            return dict.fromkeys(self.materials_by_number, here)
        own = dr.gather(type(self.material), self.material, index - FIRST, here)
        return {name: here & (own == k) for k, name in enumerate(self.materials_by_number)}

    def made_of(self, materials: Collection[str]) -> int:
        """How many spheres are made of one of these materials: none, or several."""
        return 2 * any(name in materials for name in self.materials_by_number)

    def named(self, index: Array, names: Collection[str]) -> Array:
        """Bool: the sphere of this number changes, as all of them do if one does."""
        return (index >= FIRST) & (NAME in names)

    def _sphere(self, node: TreeNode, number: Array) -> Sphere:
        """The sphere of a leaf."""
        eye = self._marked(number, 0) if self.places.under_eye else False
        return replace(node.sphere, compensated=self.places.compensated, under_eye=eye)

    def _crosses(
        self, sphere: Sphere, number: Array, ray: ShadowRay, materials: Collection[str]
    ) -> Array:
        """Bool: a sphere of one of these materials crosses the segment to a light."""
        ends_on: Any = False
        if ray.light in self.places.under_lights:
            ends_on = self._marked(number, 1 + self.places.under_lights.index(ray.light))
        if not self.made_from.isdisjoint(ray.clear):
            # Rays get into some, so the eye's side is not that of all surfaces
            ray = replace(ray, eye=None)
        crosses = sphere.blocks(ray, ray.source == number, ends_on) & ray.wanted
        if self.made_from <= set(materials):
            return crosses
        own = (here for name, here in self.materials(number).items() if name in materials)
        return crosses & any_true(own, crosses)

    def _along(self, ray, materials, state, cross, done=None):
        """Walk along the segment to a light."""
        line = Line.of(ray.o, ray.d)

        def enters(node: TreeNode, _: Any) -> Array:
            return line.enters(node, ray.distance)[1]

        return self._walk(materials, state, ray.wanted, enters, cross, done)

    def _walk(self, materials, state, active, enters, at_sphere, done=None):
        """Walk through the tree, if any sphere is of one of these materials."""
        if self.made_from.isdisjoint(materials):
            return state

        def look(node: TreeNode, state: Any) -> Any:
            number = node.number + FIRST
            return at_sphere(self._sphere(node, number), number, state)

        return walk_nodes(self.nodes, state, active, enters, look, done)

    def _marked(self, index: Array, bit: int) -> Array:
        """Bool: a bit of `special` is set."""
        here = index >= FIRST
        own = dr.gather(type(self.special), self.special, index - FIRST, here)
        return here & ((own & (1 << bit)) != 0)
