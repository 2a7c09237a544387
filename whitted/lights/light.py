"""What every light can do."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TypeVar

from ..core.arrays import Array

Own = TypeVar("Own", bound="Light")


@dataclass
class Toward:
    """A light as seen from a point."""

    direction: Array  # Array3f: unit vector to the light
    distance: Array  # infinite for a light at infinity
    squared_distance: Array
    end: Array | None  # Array3f: where the light is; None for a light at infinity


class Light(ABC):
    """A light without extent, so that shadows are hard: a frozen dataclass with a name."""

    name: str

    @abstractmethod
    def way(self, p: Array) -> Array:
        """Array3f: a vector of any length from a point towards the light."""

    @abstractmethod
    def toward(self, p: Array) -> Toward:
        """The light as seen from a point."""

    @abstractmethod
    def arriving(self, toward: Toward) -> Array:
        """Array3f: the irradiance of a surface that faces the light."""

    def prepared(self: Own) -> Own:
        """The light with unit vectors for its directions, as kernels take it."""
        return self
