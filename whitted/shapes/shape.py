"""What every shape can do.

The methods take arrays of one primitive, or of one primitive a lane. After a search each lane works
on the primitive that its ray has met, however many primitives the scene has (`sets.py`).
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import ClassVar, TypeVar

from ..core.arrays import Array, Precision
from ..core.parameter import Numbers
from ..core.ray import Ray, ShadowRay

Own = TypeVar("Own", bound="Shape")


@dataclass(frozen=True)
class Shape(ABC):
    """A primitive, or one a lane: a frozen dataclass with a name, a material and parameters."""

    # The name of its tables in a file, which is the first part of its parameters' names
    group: ClassVar[str]
    # It has an inside, which glass can fill
    closed: ClassVar[bool]
    # It can show a checkerboard
    flat: ClassVar[bool]
    # It divides space: no way leads around it
    divides: ClassVar[bool] = False
    # Its shadow has an edge that no surface is at
    casts_edges: ClassVar[bool]
    # Radiance beside its outline changes like the square root of the distance
    rooted: ClassVar[bool]

    name: str
    material: str
    # Set in kernels: it is computed with sums that keep their rounding errors
    compensated: bool = field(default=False, kw_only=True)
    # Set in kernels: the eye is exactly on it; Bool where there is one primitive a lane
    under_eye: Array | bool = field(default=False, kw_only=True)

    def approach(self, ray: Ray, on: Array) -> tuple[Array | None, tuple[Array, ...]]:
        """What is cheap to tell before `distance`.

        Returns:
            Bool, the ray may meet the shape, or None if that is not cheap to tell; and what
            `distance` needs not compute again.
        """
        return None, ()

    @abstractmethod
    def distance(self, ray: Ray, on: Array, *known: Array) -> tuple[Array, Array, Array]:
        """Where a ray meets the shape.

        Args:
            on: Bool, the ray starts on this very shape.
            known: what `approach` has found.

        Returns:
            The distance; whether the ray meets the shape; and whether it does so from within.
        """

    @abstractmethod
    def reach(self, ray: Ray, on: Array, inside: Array) -> Array:
        """The distance to the shape, also of a ray that just misses it.

        Args:
            on: Bool, the ray starts on this very shape.
            inside: Bool, the ray meets it from within.
        """

    @abstractmethod
    def blocks(self, ray: ShadowRay, on: Array, ends_on: Array | bool = False) -> Array:
        """Bool: the shape crosses the open segment from a surface to a light.

        Args:
            on: Bool, the surface is that of this very shape.
            ends_on: the light is exactly on this very shape; Bool for one primitive a lane.
        """

    def side(self, ray: ShadowRay) -> Array:
        """A point on the same side of the shape as the start of a segment to a light.

        If no ray gets through or around the shape, all surfaces that are met lie on the eye's side.
        So the eye is such a point, and what depends on it is computed once for all rays. Of a shape
        through the eye, both sides are met.
        """
        known = ray.eye is not None and self.material not in ray.clear
        return ray.eye if known and self.divides and self.under_eye is False else ray.o

    @abstractmethod
    def level(self, p: Array) -> Array:
        """A function of a point that is zero on the surface, and changes its sign there."""

    @abstractmethod
    def implicit(self, p: Array) -> tuple[Array, Array]:
        """Such a function, cheap to differentiate, and its gradient, which points outward."""

    @abstractmethod
    def outline(self, o: Array, d: Array) -> Array:
        """A function of a line that is positive where the line meets the shape, and zero where it
        touches the outline: the level function of silhouettes and of shadow edges.
        """

    def extent(self) -> Array:
        """The size of a closed shape: of two that overlap the smaller fills what both contain."""
        return math.inf

    def prepared(self: Own) -> Own:
        """The shape with unit vectors for its directions, as kernels take it."""
        return self

    @classmethod
    def place(cls, *numbers: Numbers) -> Hashable:
        """Where a shape with these numbers is, in the order of its parameters.

        Two shapes of a kind in the same place are one object.
        """
        return numbers

    @classmethod
    @abstractmethod
    def passes_through(cls, point: Numbers, precision: Precision, *numbers: Numbers) -> bool:
        """Whether a point is exactly on a shape with these numbers, which have some precision."""

    @classmethod
    def needs_compensation(cls, eye: Numbers, precision: Precision, *numbers: Numbers) -> bool:
        """Whether rays from the eye need compensated sums to meet a shape with these numbers."""
        return False
