"""Which surfaces change with some parameters. The light of the others needs no derivatives."""

from collections.abc import Iterable
from dataclasses import dataclass

from ..core.arrays import Array, any_true
from ..core.ray import Ray
from ..scene.features import may, sends_rays
from ..scene.scene import Scene
from ..shapes.many import NAME as MANY
from ..tracing.intersect import closest_hit
from ..tracing.surface import materials_of


@dataclass(frozen=True)
class Changed:
    """The shapes and the materials that change, by name."""

    shapes: frozenset[str]
    materials: frozenset[str]

    def among(self, scene: Scene, index: Array) -> Array:
        """Bool: a primitive is one of those that change."""
        of = materials_of(scene, index)
        named = (primitives.named(index, self.shapes) for primitives in scene.sets)
        made = (here for material, here in of.items() if material in self.materials)
        return any_true((*named, *made), index == 0)

    def reached(self, scene: Scene, ray: Ray) -> Array:
        """Bool: a ray's first surface changes, or sends rays that may meet one that does."""
        index = closest_hit(scene, ray).index
        sends = {m.name for m in scene.used if sends_rays(scene, m)}
        of = materials_of(scene, index).items()
        sending = (here for material, here in of if material in sends)
        return any_true(sending, index == 0) | self.among(scene, index)


def changed(scene: Scene, names: Iterable[str]) -> Changed | None:
    """What changes with the parameters of these names; None if everything does."""
    shapes, materials = set(), set()
    for name in names:
        where = scene.locations[name]
        if where.field == "shapes" and where.place is not None:
            shapes.add(scene.shapes[where.place].name)
        elif where.field == "materials" and where.place is not None and where.path != ("shadow",):
            materials.add(scene.materials[where.place].name)
            if where.path == ("ior",):
                # An index of refraction also changes what its neighbours' surfaces reflect
                materials |= _with_interfaces(scene)
        else:
            return None
    many = scene.many
    if scene.gathered is not None:
        shapes.add(MANY)
    others = many is not None and not (MANY in shapes or many.made_from <= materials)
    if not others and all(x.name in shapes or x.material in materials for x in scene.shapes):
        return None
    return Changed(frozenset(shapes), frozenset(materials))


def _with_interfaces(scene: Scene) -> set[str]:
    """The materials whose surfaces reflect according to the media around them."""
    clear = {m.name for m in scene.materials if may(scene, m, "refraction")}
    return clear | scene.features.coated
