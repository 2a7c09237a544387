"""What a scene's kernels have compiled in, derived from its numbers: no more than the scene needs.

A parameter with its neutral value (a weight of 0, a shadow of 1) is left out of the code, unless
`Scene.replace` has touched it. What an optimiser moves must not compile a new kernel when it passes
through that value, and a derivative at that value needs the code.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from ..shapes import SHAPES, Sphere
from ..shapes.places import Places, places_of
from .material import Material
from .parameters import Location

if TYPE_CHECKING:
    from .contents import Contents


@dataclass(frozen=True)
class Features:
    """Facts about a scene that decide what is compiled."""

    # Parameters that have a neutral value, and may now have another one
    live: frozenset[str]
    # Materials that are opaque and reflect like polished dielectrics
    coated: frozenset[str]
    # Materials whose shapes keep no light away
    shadowless: frozenset[str]
    # Where the primitives are, as seen from the eye and the lights
    places: Places


# Beginnings of the names of parameters that tell where the shapes, the lights and the eye are
PLACES = ("camera.position", "lights.", "clouds.", *(f"{kind.group}." for kind in SHAPES))


def features_of(
    scene: "Contents", before: Features | None = None, changed: Collection[str] = ()
) -> Features:
    """The features of a scene, from the numbers that it has now.

    Args:
        before: the features from before some parameters changed; what cannot have changed since is
            not computed again.
        changed: the names of those parameters.
    """
    if before is None or not scene.neutral.keys().isdisjoint(changed):
        of_materials = _of_materials(scene)
    else:
        of_materials = before.live, before.coated, before.shadowless
    if before is None or any(name.startswith(PLACES) for name in changed):
        places = _of_places(scene)
    else:
        places = before.places
    return Features(*of_materials, places)


def _of_materials(scene: "Contents") -> tuple[frozenset[str], frozenset[str], frozenset[str]]:
    """Which parameters are live, and which materials are coated and shadowless."""
    numbers, touched = scene.numbers, scene.touched
    live = {
        name
        for name, neutral in scene.neutral.items()
        if name in touched or numbers[name] != neutral
    }
    coated, shadowless = set(), set()
    for material in scene.materials:
        prefix = f"materials.{material.name}"
        polished = material.fresnel and f"{prefix}.reflection" in live
        if polished and numbers[f"{prefix}.refraction"] == (0,):
            coated.add(material.name)
        if f"{prefix}.shadow" not in touched and numbers[f"{prefix}.shadow"] == (0,):
            shadowless.add(material.name)
    return frozenset(live), frozenset(coated), frozenset(shadowless)


def _of_places(scene: "Contents") -> Places:
    numbers = scene.numbers
    by_shape = ([numbers[name] for name in names] for names in scene.names_by_shape)
    lights = [numbers.get(f"lights.{light.name}.position") for light in scene.lights]
    eye = numbers["camera.position"]
    places = places_of(scene.singles, by_shape, eye, lights, scene.precision)
    return replace(places, many=scene.marked[0]) if scene.sources else places


def may(scene: "Contents", material: Material, field: str) -> bool:
    """Whether a material's parameter can differ from its neutral value, and must be compiled."""
    return f"materials.{material.name}.{field}" in scene.features.live


def is_idle(scene: "Contents", where: Location) -> bool:
    """Whether nothing depends on a parameter: on the index of what bends no light, and on the
    shininess of what has no highlights.
    """
    if where.field != "materials" or where.place is None:
        return False
    material = scene.materials[where.place]
    if where.path == ("ior",):
        return not (may(scene, material, "refraction") or material.name in scene.features.coated)
    return where.path == ("shininess",) and not may(scene, material, "specular")


def reflects(scene: "Contents") -> bool:
    """Whether any material can send a reflected ray."""
    return any(sends_rays(scene, m) for m in scene.used)


def sends_rays(scene: "Contents", material: Material) -> bool:
    """Whether a material can send a reflected ray, as mirrors do, and glass by total reflection."""
    return may(scene, material, "reflection") or may(scene, material, "refraction")


def mirrors(scene: "Contents") -> int:
    """How many spheres mirror and let no light through."""
    opaque = {
        material.name
        for material in scene.materials
        if may(scene, material, "reflection") and not may(scene, material, "refraction")
    }
    single = sum(shape.material in opaque for shape in scene.singles if isinstance(shape, Sphere))
    return single + sum(own.count for own in scene.sources if own.material in opaque)


def refracts(scene: "Contents") -> bool:
    return any(may(scene, m, "refraction") for m in scene.used)


def branches_out(scene: "Contents") -> bool:
    """Whether any material can send both rays at once; without one the tree is a chain."""
    return any(may(scene, m, "reflection") and may(scene, m, "refraction") for m in scene.used)


def coats(scene: "Contents") -> bool:
    """Whether anything opaque reflects like a polished dielectric."""
    return any(m.name in scene.features.coated for m in scene.used)


def bends(scene: "Contents") -> bool:
    """Whether any interface between two media matters: of glass, or of what is polished."""
    return refracts(scene) or coats(scene)


def weights_vary(scene: "Contents") -> bool:
    """Whether weights depend on the angle, so that they can change while no decision flips."""
    return any(m.fresnel for m in scene.used) and bends(scene)


def glossy(scene: "Contents") -> bool:
    """Whether any material has highlights."""
    return any(may(scene, m, "specular") for m in scene.used)


def shadow(scene: "Contents", material: Material) -> Literal["full", "part", "none"]:
    """How much of a light a material keeps away."""
    if material.name in scene.features.shadowless:
        return "none"
    return "part" if may(scene, material, "shadow") else "full"


def can_be_recorded(scene: "Contents") -> bool:
    """Whether rays form chains, and a bit for each light tells what keeps it away."""
    full = all(shadow(scene, material) != "part" for material in scene.used)
    return full and not branches_out(scene) and len(scene.lights) < 32
