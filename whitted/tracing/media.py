"""The media on both sides of a surface.

A point is filled by the smallest transparent primitive that contains it, and on equal sizes by the
first in the file.
"""

import math

import drjit as dr

from ..core.arrays import Array, any_true
from ..core.ray import NONE
from ..scene.features import coats, may
from ..scene.material import Material
from ..scene.scene import Scene
from ..shapes.sets import Medium
from .surface import Surface, lookup

# Material to its index of refraction, and Bool, whether it is transparent
Fills = dict[str, tuple[Array, Array]]


def relative_index(scene: Scene, at: Surface) -> Array:
    """eta = n_incident / n_transmitted, looked for once.

    An opaque surface that reflects like a polished dielectric has its material's index behind it.
    """
    if not at.etas:
        at.etas.append(_relative_index(scene, at))
    return at.etas[0]


def _relative_index(scene: Scene, at: Surface) -> Array:
    fills = {m.name: (m.ior, _is_clear(m)) for m in scene.used if may(scene, m, "refraction")}
    inside, own = at.hit.inside, _own_medium(at, fills)
    alone = sum(primitives.made_of(fills) for primitives in scene.sets) == 1
    if alone and not coats(scene):
        return dr.select(inside, own.ior, 1) / dr.select(inside, 1, own.ior)
    outer = _outer_medium(scene, at, fills)
    first = (own.extent == outer.extent) & (own.index < outer.index)
    fills_inside = (own.index != NONE) & ((own.extent < outer.extent) | first)
    inner_ior = dr.select(fills_inside, own.ior, outer.ior)
    eta = dr.select(inside, inner_ior, outer.ior) / dr.select(inside, outer.ior, inner_ior)
    if not coats(scene):
        return eta
    coated = [m for m in scene.used if m.name in scene.features.coated]
    polished = any_true((_is_polished(at, m) for m in coated), at.hits)
    ior = lookup(scene, at, "ior", lambda m: m.name in scene.features.coated)
    return dr.select(polished, outer.ior / dr.select(polished, ior, 1), eta)


def _is_polished(at: Surface, material: Material) -> Array:
    """Bool: a surface is opaque and polished.

    Seen from within, it is glass while its refraction is differentiated: that is the limit of glass
    that refracts ever less.
    """
    here = at.of[material.name]
    return here & ~at.hit.inside if dr.grad_enabled(material.refraction) else here


def _is_clear(material: Material) -> Array:
    """Whether a material is transparent: its weight is not 0, or the 0 is being differentiated."""
    clear = material.refraction != 0
    return type(clear)(True) if dr.grad_enabled(material.refraction) else clear


def _own_medium(at: Surface, fills: Fills) -> Medium:
    """What fills the primitive that was hit, if it is transparent and has an inside."""
    real, index = dr.value_t(at.p), at.hit.index
    ior, own = real(1), dr.mask_t(at.hit.t)(False)
    for name, (its_ior, clear) in fills.items():
        here = at.of[name] & clear & at.shape.whether(lambda kind: kind.closed)
        ior, own = dr.select(here, its_ior, ior), own | here
    extent = dr.detach(at.shape.of(lambda shape: shape.extent()))
    return Medium(ior, dr.select(own, extent, real(math.inf)), dr.select(own, index, NONE))


def _outer_medium(scene: Scene, at: Surface, fills: Fills) -> Medium:
    """What fills space around the point, but for the primitive that was hit."""
    real = dr.value_t(at.p)
    medium = Medium(real(1), real(math.inf), dr.uint32_array_t(real)(NONE))
    for primitives in dr.detach(scene).sets:
        medium = primitives.innermost(dr.detach(at.p), at.hit.index, medium, fills)
    return medium
