"""Which surfaces change with some parameters: the light of the others needs no derivatives."""

from collections.abc import Iterable
from dataclasses import dataclass

from ..core.arrays import Array
from ..scene.features import may
from ..scene.scene import Scene
from ..tracing.surface import materials_of


@dataclass(frozen=True)
class Changed:
    """The shapes and the materials that change by themselves."""

    shapes: frozenset[str]
    materials: frozenset[str]

    def among(self, scene: Scene, index: Array) -> Array:
        """Whether a primitive is one of those that change."""
        of = materials_of(scene, index)
        result = type(index == 0)(False)
        for primitives in scene.sets:
            result |= primitives.named(index, self.shapes)
        for material in self.materials & of.keys():
            result |= of[material]
        return result


def changed(scene: Scene, names: Iterable[str]) -> Changed | None:
    """What changes with the parameters of these names; None where that is all, or all light."""
    shapes, materials = set(), set()
    for name in names:
        where = scene.locations[name]
        if where.field == "shapes" and where.place is not None:
            shapes.add(scene.shapes[where.place].name)
        elif where.field == "materials" and where.place is not None and where.path != ("shadow",):
            materials.add(scene.materials[where.place].name)
            if where.path == ("ior",):
                # An index counts for what lies inside, too
                materials |= _with_interfaces(scene)
        else:
            return None
    if all(shape.name in shapes or shape.material in materials for shape in scene.shapes):
        return None
    return Changed(frozenset(shapes), frozenset(materials))


def _with_interfaces(scene: Scene) -> set[str]:
    """The materials at which rays notice the media around."""
    clear = {m.name for m in scene.materials if may(scene, m, "refraction")}
    return clear | scene.features.coated
