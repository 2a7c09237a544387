"""What every shape can do.

The methods take arrays of one primitive, or of one primitive a lane: after a search each lane works
on the primitive that its ray has met, whatever the number of primitives in the scene (`sets.py`).
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Hashable
from typing import Any, ClassVar, TypeVar

from ..core.arrays import Array
from ..core.ray import Ray, ShadowRay

Self = TypeVar("Self", bound="Shape")
Numbers = tuple[float, ...]


class Shape(ABC):
    """A primitive, or one a lane. Each subclass is a frozen dataclass with a name, a material and
    parameters.
    """

    group: ClassVar[str]  # the name of its tables in a file, and of its parameters
    closed: ClassVar[bool]  # it has an inside, which can be filled with glass
    flat: ClassVar[bool]  # it can show a checkerboard
    casts_edges: ClassVar[bool]  # its shadow has an edge of its own
    rooted: ClassVar[
        bool
    ]  # beside its outline radiance changes like the square root of the distance
    compensated: bool = False  # it is computed with sums that keep their rounding errors

    name: str
    material: str

    @abstractmethod
    def distance(self, ray: Ray, on: Array) -> tuple[Array, Array, Array]:
        """Where a ray meets the shape.

        Args:
            on: Bool, the ray starts on this very shape.

        Returns:
            The distance t, whether the ray meets the shape at all, and whether it does so from
            within.
        """

    @abstractmethod
    def reach(self, ray: Ray, on: Array, inside: Array) -> Array:
        """The distance to the shape, which a ray meets from within or not, also of a ray that just
        misses it.
        """

    @abstractmethod
    def blocks(self, ray: ShadowRay, on: Array) -> Array:
        """Whether the shape crosses the open segment to a light, which may start on this very
        shape.
        """

    @abstractmethod
    def level(self, p: Array) -> Array:
        """A function of a point that is zero on the shape's surface (or the surface it is cut from), and differs in
        sign on its two sides."""

    @abstractmethod
    def implicit(self, p: Array) -> tuple[Array, Array]:
        """A level function that is cheap to differentiate, and its gradient by the point."""

    @abstractmethod
    def outline(self, o: Array, d: Array) -> Array:
        """A function of a line that is zero where the line touches the shape's outline, and
        positive where it meets it.
        """

    def extent(self) -> Array:
        """The size of a closed shape: the smaller of two that overlap fills what both contain.
        Infinite for others.
        """
        return math.inf

    def prepared(self: Self) -> Self:
        """The shape with unit vectors for its directions."""
        return self

    @classmethod
    @abstractmethod
    def blank(cls: type[Self], color: Any) -> Self:
        """Some legal shape, with arrays like that of a colour, for lanes that have met none."""

    @staticmethod
    @abstractmethod
    def place(*numbers: Numbers) -> Hashable:
        """Where a shape with these numbers is, in the order of its parameters: two in one place are
        one object.
        """

    @staticmethod
    def needs_compensation(eye: Numbers, *numbers: Numbers) -> bool:
        """Whether single precision needs compensated sums to meet a shape with these numbers from
        an eye.
        """
        return False
