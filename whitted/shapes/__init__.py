"""Shapes: what rays can meet. Each is one file, and one entry here."""

from .disc import Disc
from .plane import Plane
from .shape import Shape
from .sphere import Sphere

# In the order in which primitives are numbered
SHAPES: tuple[type[Shape], ...] = (Sphere, Plane, Disc)

__all__ = ["SHAPES", "Disc", "Plane", "Shape", "Sphere"]
