"""The scene: what there is, its parameters by name, and which primitive a ray meets.

Primitives are counted spheres first, then planes, each in the order of the file; on equal distance the first wins.
What a scene cannot need is left out when its kernel is traced: `Scene.nonzero` names the parameters that may be
other than 0, which are those that the file sets so and all that `replace` has touched.
"""

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import drjit as dr
import numpy as np

from .camera import Camera
from .geometry import NONE, Array, Plane, Ray, Sphere, plane_blocks, plane_distance, sphere_blocks, sphere_distance

# Nodes on a chain of rays, and primitives and lights in a scene, that a kernel is compiled for
MAX_DEPTH = 256
MAX_OBJECTS = 1000


@dataclass(frozen=True)
class Checker:
    color: tuple[float, float, float]
    size: float


@dataclass(frozen=True)
class Material:
    name: str
    color: Array  # Lambertian albedo, linear RGB in [0, 1]
    specular: Array  # Blinn-Phong coefficient, >= 0
    shininess: Array  # Blinn-Phong exponent, > 0
    reflection: Array  # weight of the mirrored ray, in [0, 1]
    refraction: Array  # weight of the refracted ray, in [0, 1]
    ior: Array  # index of refraction, > 0
    fresnel: bool
    checker: Checker | None


@dataclass(frozen=True)
class PointLight:
    name: str
    position: Array
    intensity: Array
    inverse_square: bool


@dataclass
class Hit:
    """The nearest primitive along a ray (not frozen: Dr.Jit's loops write to their state)."""

    t: Array  # distance, infinite for a ray that leaves the scene
    index: Array  # UInt32: the primitive, or NONE
    inside: Array  # Bool: the ray travelled in the sphere that it hit


PARAMETERS = {
    "spheres": ("center", "radius"),
    "planes": ("normal", "offset"),
    "materials": ("color", "specular", "shininess", "reflection", "refraction", "ior"),
    "lights": ("position", "intensity"),
    "camera": ("position", "look_at", "fov"),
}

# Open ranges outside of which these have no meaning
RANGES = {"radius": (0.0, math.inf), "ior": (0.0, math.inf), "shininess": (0.0, math.inf), "fov": (0.0, 180.0)}


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene, frozen; `replace` makes a new one."""

    camera: Camera
    resolution: tuple[int, int]
    spheres: tuple[Sphere, ...]
    planes: tuple[Plane, ...]
    materials: tuple[Material, ...]
    lights: tuple[PointLight, ...]
    background: Array
    ambient: Array
    max_depth: int
    min_importance: float
    nonzero: tuple[str, ...]
    twins: tuple[tuple[int, int], ...]  # pairs of primitives that coincide in the file

    def parameters(self, *names: str) -> dict[str, Array]:
        """Copies of the parameters of these names, or of all: scalars of width 1, vectors `Array3f` of width 1.

        Raises:
            KeyError: a name that the scene does not have; the message lists the nearest ones.
        """
        known = self.locations
        _check_names(names, known)
        values = {name: self._read(known[name]) for name in names or known}
        return {name: type(value)(value) for name, value in values.items()}

    def replace(self, values: Mapping[str, Array]) -> "Scene":
        """A new scene with these parameters, differentiable in what was replaced.

        Args:
            values: parameter name to a Dr.Jit array of width 1, or to a number or three of them; a dictionary or a
                `drjit.opt` optimiser. Gradients are tracked through the arrays as they are given.

        Raises:
            KeyError: a name that the scene does not have; the message lists the nearest ones.
            ValueError: a value that is not one scalar, or not one vector, as its parameter is; or that has no meaning: one
                that is not finite, a radius, index or shininess that is not above 0, a field of view not in (0, 180).
        """
        known = self.locations
        _check_names(values.keys(), known)
        arrays = {name: _as_parameter(name, value, self._read(known[name])) for name, value in values.items()}
        _check_values(arrays)
        scene = self.carrying(arrays)
        nonzero = tuple(sorted({*self.nonzero, *values.keys()}))
        return scene._with({"nonzero": nonzero})

    def carrying(self, values: Mapping[str, Array]) -> "Scene":
        """The scene with these arrays for its parameters, unchecked and of any width."""
        known = self.locations
        fields: dict[tuple[str, int], dict[str, Array]] = {}
        for name, value in values.items():
            kind, position, field = known[name]
            fields.setdefault((kind, position), {})[field] = value
        groups: dict[str, list] = {}
        changes: dict[str, object] = {}
        for (kind, position), new in fields.items():
            if kind in ("background", "ambient"):
                changes[kind] = new[kind]
            elif kind == "camera":
                changes[kind] = replace(self.camera, **new)
            else:
                group = groups.setdefault(kind, list(getattr(self, kind)))
                group[position] = replace(group[position], **new)
        changes.update({kind: tuple(group) for kind, group in groups.items()})
        return self._with(changes)

    def _with(self, changes: dict) -> "Scene":
        """A copy with these fields, which has the same parameters."""
        scene = replace(self, **changes)
        scene.__dict__["locations"] = self.locations
        return scene

    @cached_property
    def locations(self) -> dict[str, tuple[str, int, str]]:
        """Parameter name to group, place in the group, field."""
        locations: dict[str, tuple[str, int, str]] = {}
        for kind, fields in PARAMETERS.items():
            group = (self.camera,) if kind == "camera" else getattr(self, kind)
            for position, item in enumerate(group):
                prefix = kind if kind == "camera" else f"{kind}.{item.name}"
                locations.update({f"{prefix}.{field}": (kind, position, field) for field in fields})
        return locations | {name: (name, 0, name) for name in ("background", "ambient")}

    def _read(self, location: tuple[str, int, str]) -> Array:
        kind, position, field = location
        group = getattr(self, kind)
        if kind in ("background", "ambient"):
            return group
        return getattr(group if kind == "camera" else group[position], field)

    @cached_property
    def shape(self) -> "Shape":
        """The scene without its arrays."""
        return Shape(self)

    @cached_property
    def used(self) -> tuple[Material, ...]:
        """The materials that some primitive is made of."""
        names = {sphere.material for sphere in self.spheres} | {plane.material for plane in self.planes}
        return tuple(material for material in self.materials if material.name in names)

    def may(self, material: Material, field: str) -> bool:
        """Whether a material's weight can be other than 0, and so is worth compiling."""
        return f"materials.{material.name}.{field}" in self.nonzero

    def material_of(self, primitive: int) -> str:
        spheres = len(self.spheres)
        return self.spheres[primitive].material if primitive < spheres else self.planes[primitive - spheres].material


class Shape:
    """All of a scene that its kernels are compiled for, and nothing that they read: hashable, and not an array."""

    def __init__(self, scene: Scene) -> None:
        spheres = [(sphere.name, sphere.material, sphere.wide) for sphere in scene.spheres]
        planes = [(plane.name, plane.material) for plane in scene.planes]
        kinds = [(m.name, m.fresnel, m.checker) for m in scene.materials]
        lights = [(light.name, light.inverse_square) for light in scene.lights]
        rest = scene.camera.up, type(scene.background), scene.nonzero, scene.twins
        self.key = tuple(spheres), tuple(planes), tuple(kinds), tuple(lights), rest
        self.scene = scene

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Shape) and self.key == other.key

    def filled(self, parameters: Mapping[str, Array]) -> Scene:
        """A scene of this shape with these parameters, which must be all of them."""
        return self.scene.carrying(parameters)


def _check_names(names: Iterable[str], known: Mapping[str, object]) -> None:
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(str(name), known, n=3, cutoff=0.5) or list(known)[:3]
            raise KeyError(f"the scene has no parameter '{name}'; nearest: {', '.join(near)}")


def _as_parameter(name: str, value: object, old: Array) -> Array:
    """The value as an array of the old one's type."""
    want, size = ("one vector of three numbers", 3) if dr.depth_v(old) == 2 else ("one number", 1)
    if value is not None and dr.is_jit_v(value):
        if (dr.depth_v(value), dr.size_v(value)) != (dr.depth_v(old), dr.size_v(old)) or dr.width(value) != 1:
            raise ValueError(f"{name}: expected {want}, got {type(value).__name__} of shape {dr.shape(value)}")
        return value if type(value) is type(old) else type(old)(value)
    try:
        numbers = np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.size != size or not np.isfinite(numbers).all():
        raise ValueError(f"{name}: expected {want}, got {value!r}")
    return type(old)(*numbers.tolist())


def _check_values(arrays: Mapping[str, Array]) -> None:
    """Refuse numbers that have no meaning, as a step of an optimiser may bring them; not while a kernel is recorded."""
    if dr.flag(dr.JitFlag.SymbolicScope) or dr.flag(dr.JitFlag.FreezingScope):
        return
    known = {name: dr.detach(array) for name, array in arrays.items()}
    dr.eval(known)
    for name, array in known.items():
        numbers = [part[0] for part in array] if dr.depth_v(array) == 2 else [array[0]]
        low, high = RANGES.get(name.rpartition(".")[2], (-math.inf, math.inf))
        told = f"{name} = {', '.join(f'{x:g}' for x in numbers)}"
        if not all(low < x < high for x in numbers):
            finite = "finite numbers" if math.isinf(low) else f"a number in ({low:g}, {high:g})"
            raise ValueError(f"{told}: expected {finite}; bound the steps of the optimiser")
        if name.endswith(".normal") and not any(numbers):
            raise ValueError(f"{told}: expected a direction")


def starts_on(scene: Scene, source: Array, primitive: int) -> Array:
    """Whether a ray starts on a primitive, or on one that coincides with it."""
    on = source == primitive
    for a, b in scene.twins:
        if primitive in (a, b):
            on |= (source == (a + b - primitive)) & _coincide(scene, a, b)
    return on


def _coincide(scene: Scene, a: int, b: int) -> Array:
    """Whether two primitives that the file put in one place are still there."""
    spheres = len(scene.spheres)
    if a < spheres:
        s, t = scene.spheres[a], scene.spheres[b]
        return dr.all(s.center == t.center) & (s.radius == t.radius)
    p, q = scene.planes[a - spheres], scene.planes[b - spheres]
    flip = dr.select(dr.dot(p.normal, q.normal) < 0, -1, 1)
    return dr.all(p.normal == q.normal * flip) & (p.offset == q.offset * flip)


def closest_hit(scene: Scene, ray: Ray) -> Hit:
    """The nearest primitive in front of the ray."""
    real, mask = dr.value_t(type(ray.o)), dr.mask_t(ray.o.x)
    t, index, inside = real(dr.inf), dr.uint32_array_t(real)(NONE), mask(False)
    for k, sphere in enumerate(scene.spheres):
        distance, meets, within = sphere_distance(sphere, ray, starts_on(scene, ray.source, k))
        nearer = meets & (distance < t)
        t, index = dr.select(nearer, distance, t), dr.select(nearer, k, index)
        inside = dr.select(nearer, within, inside)
    for k, plane in enumerate(scene.planes, len(scene.spheres)):
        distance = plane_distance(plane, ray)
        nearer = (distance > 0) & (distance < t) & ~starts_on(scene, ray.source, k)
        t, index, inside = dr.select(nearer, distance, t), dr.select(nearer, k, index), inside & ~nearer
    return Hit(t, index, inside)


def occluded(scene: Scene, p: Array, light: PointLight, to_light: Array, distance: Array, hit: Hit) -> Array:
    """Whether anything crosses the open segment from a point on a surface to a light."""
    blocked = dr.mask_t(distance)(False)
    for k, sphere in enumerate(scene.spheres):
        on = starts_on(scene, hit.index, k)
        blocked |= sphere_blocks(sphere, p, light.position, to_light, distance, on, hit.inside)
    for k, plane in enumerate(scene.planes, len(scene.spheres)):
        blocked |= plane_blocks(plane, p, light.position) & ~starts_on(scene, hit.index, k)
    return blocked
