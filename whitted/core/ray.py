"""Rays: those that look for a surface, and those that look for a light.

Conventions. Directions are unit vectors along the ray's travel. A ray knows the primitive that it
starts on (`source`, its number in the scene, or `NONE` for a ray from the eye), and whether it
leaves into that primitive (`inward`). So algebra keeps a surface from meeting its own rays, and no
epsilon is needed.
"""

from dataclasses import dataclass

from .arrays import Array

# The number of no primitive. Those of the spheres in a tree are larger, and all others smaller
NONE = 0xFFFF


@dataclass
class Ray:
    """A ray, or a wavefront of them (not frozen: Dr.Jit's loops write to their state)."""

    o: Array  # Array3f: origin
    d: Array  # Array3f: unit direction
    source: Array  # UInt32: number of the primitive that it starts on, or NONE at the eye
    inward: Array  # Bool: it leaves into the primitive `source`


@dataclass
class ShadowRay:
    """The open segment from a point on a surface to a light."""

    o: Array  # Array3f: the point
    d: Array  # Array3f: unit direction to the light
    distance: Array  # to the light, infinite for one at infinity
    end: Array | None  # Array3f: where the light is; None for one at infinity
    source: Array  # UInt32: number of the primitive that the point lies on
    inward: Array  # Bool: the segment leaves into that primitive
    wanted: Array | bool = True  # Bool: it matters what is in between
    light: int = 0  # the light's number
    # Numbers of the primitives that the light is exactly on
    ends_on: frozenset[int] = frozenset()
    # Array3f: the eye that the tree of rays begins at, if that is known; and the names of the
    # materials that let rays through
    eye: Array | None = None
    clear: frozenset[str] = frozenset()
