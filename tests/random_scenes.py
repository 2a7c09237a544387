"""Random legal scenes of a few shapes, as numbers: scenes of one shape share their kernels.

A scene is a dictionary from the name of a parameter to NumPy numbers, which `Shape.scene` makes a
scene of. Every sphere has a material of its own, so that spheres can change places without a kernel
of their own.
"""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np
from gradcheck import as_type
from samples import plane, sphere

HEAD = "[camera]\nposition = [0, 0, 5]\nlook_at = [0, 0, 0]\nup = {up}\nfov = 50\nresolution = [24, 24]\n"
LIGHT = 'intensity = [1, 1, 1]\nfalloff = "{}"'
UP = np.array([0.1, 1.0, -0.2])


@dataclass(frozen=True)
class Shape:
    """What is compiled: how many of everything, and which materials and lights are of which kind."""

    spheres: int
    planes: int
    lights: int
    fresnel: tuple[bool, ...] = (False, True)  # of the materials, in turns

    @property
    def text(self):
        """A scene file of this shape; its numbers are only there to be replaced."""
        materials = self.spheres + self.planes
        flags = [str(self.fresnel[i % len(self.fresnel)]).lower() for i in range(materials)]
        return "\n".join(
            [
                HEAD.format(up=UP.tolist()),
                *(f"[materials.m{i}]\nfresnel = {flag}" for i, flag in enumerate(flags)),
                *(sphere([float(i), 0, 0], 0.3, f"m{i}") for i in range(self.spheres)),
                *(plane([0, 1, 0], 2 + i, f"m{self.spheres + i}") for i in range(self.planes)),
                *(
                    f"[[lights]]\nposition = [1, 2, {i}]\n{LIGHT.format(self.falloff(i))}"
                    for i in range(self.lights)
                ),
            ]
        )

    @staticmethod
    def falloff(light):
        return ("none", "inverse-square")[light % 2]


SHAPES = {
    "nothing": Shape(0, 0, 0),
    "floor": Shape(0, 1, 1),
    "ball": Shape(1, 0, 2),
    "glass": Shape(3, 1, 1, (False,)),
    "mixed": Shape(5, 2, 2),
    "crowd": Shape(12, 0, 2, (True, False, False)),
}


def scene_of(loaded, numbers):
    """The scene with all of these numbers in place of its own."""
    old = loaded.parameters()
    values = {name: as_type(old[name], value) for name, value in numbers.items()}
    # Numbers that Dr.Jit knows would be part of kernels, those of `numpy()` among them
    dr.make_opaque(values)
    return loaded.replace(values)


def random_numbers(shape, seed, beside=0.0):
    """Anything legal: spheres in each other's way, of radii from 1e-3 to 1e3, and lights and the
    camera anywhere.

    Args:
        beside: how far those that are on a surface are off it, relative to its radius; a rounding
            decides where 0 is.
    """
    rng = np.random.default_rng(seed)
    wild = rng.random() < 0.3
    extent = 10 ** rng.uniform(-2, 2)
    radii = 10 ** (
        rng.uniform(-3, 3, shape.spheres)
        if wild
        else rng.uniform(-1.5, 0, shape.spheres) + np.log10(extent)
    )
    radii = np.clip(radii, 1e-3, 1e3)
    centers = rng.uniform(-1, 1, (shape.spheres, 3)) * extent
    numbers = {"background": rng.uniform(0, 1, 3), "ambient": rng.uniform(0, 0.5, 3)}
    for i in range(shape.spheres):
        numbers |= {f"spheres.sphere{i}.center": centers[i], f"spheres.sphere{i}.radius": radii[i]}
    for i in range(shape.planes):
        normal = rng.normal(size=3)
        numbers[f"planes.plane{i}.normal"] = normal / np.linalg.norm(normal)
        numbers[f"planes.plane{i}.offset"] = rng.uniform(-1, 3) * extent
    for i in range(shape.spheres + shape.planes):
        numbers |= {f"materials.m{i}.{key}": value for key, value in _material(rng).items()}
    for i in range(shape.lights):
        position = _place(rng, centers, radii, extent, beside)
        numbers |= {
            f"lights.light{i}.position": position,
            f"lights.light{i}.intensity": rng.uniform(0, 2, 3),
        }
    position = _place(rng, centers, radii, extent, beside)
    look_at = position + rng.normal(size=3) * extent
    return numbers | {
        "camera.position": position,
        "camera.look_at": look_at,
        "camera.fov": rng.uniform(10, 150),
    }


def _material(rng):
    def maybe(x):
        return x if rng.random() < 0.7 else 0.0

    return {
        "color": rng.uniform(0, 1, 3),
        "specular": maybe(rng.uniform(0, 1)),
        "shininess": 10 ** rng.uniform(0, 2.5),
        "reflection": maybe(rng.uniform(0, 1)),
        "refraction": maybe(rng.uniform(0, 1)),
        "ior": rng.uniform(0.5, 2.5) if rng.random() < 0.9 else 1.0,
    }


def _place(rng, centers, radii, extent, beside):
    """A point outside or anywhere, in a sphere, at its center, or, but for a rounding, on it."""
    kind = rng.choice(["far", "anywhere", "in", "center", "on"], p=[0.5, 0.2, 0.15, 0.05, 0.1])
    if kind in ("far", "anywhere") or not len(radii):
        return rng.normal(size=3) * extent * (2 if kind == "far" else 0.5)
    i = rng.integers(len(radii))
    direction = rng.normal(size=3)
    distance = {"in": rng.uniform(0, 1), "center": 0, "on": 1 + beside}[kind]
    return centers[i] + direction / np.linalg.norm(direction) * radii[i] * distance


def length_scale(numbers):
    """The largest coordinate or radius, of whose roundings positions are made."""
    lengths = [
        value
        for name, value in numbers.items()
        if name.endswith(("center", "radius", "position", "look_at", "offset"))
    ]
    return max(np.max(np.abs(value)) for value in lengths)


def jiggled(numbers, seed, amount):
    """The scene with its lengths and directions changed by some, relative to its size."""
    rng, scale = np.random.default_rng(seed), length_scale(numbers)
    sizes = {
        "center": scale,
        "radius": scale,
        "position": scale,
        "look_at": scale,
        "offset": scale,
        "normal": 1,
        "ior": 1,
    }
    moved = {}
    for name, value in numbers.items():
        size = sizes.get(name.rpartition(".")[2], 0)
        change = (
            rng.choice([-1, 1], np.shape(value))
            * rng.uniform(0.5, 1, np.shape(value))
            * amount
            * size
        )
        moved[name] = (
            np.maximum(value + change, value / 2) if name.endswith("radius") else value + change
        )
    return moved


@dataclass(frozen=True)
class Similarity:
    """x -> scale * rotation x + shift, and a new order of spheres, planes and lights."""

    rotation: np.ndarray
    scale: float
    shift: np.ndarray
    order: np.random.Generator

    def __call__(self, shape, numbers):
        """The same scene elsewhere; how far a light reaches grows with it."""
        moved = {}
        for name, value in numbers.items():
            field = name.rpartition(".")[2]
            if field in ("center", "position", "look_at"):
                value = self.scale * self.rotation @ value + self.shift
            elif field == "radius":
                value = value * self.scale
            elif field == "normal":
                value = self.rotation @ value
            elif field == "offset":
                value = (
                    value * self.scale
                    - (self.rotation @ numbers[name.replace("offset", "normal")]) @ self.shift
                )
            elif (
                field == "intensity"
                and shape.falloff(int(name.split(".")[1][5:])) == "inverse-square"
            ):
                value = value * self.scale**2
            moved[name] = value
        return self._reordered(shape, moved)

    def _reordered(self, shape, numbers):
        """Things change places with others that are compiled alike; a material goes with what is
        made of it.
        """
        kinds = [shape.fresnel[i % len(shape.fresnel)] for i in range(shape.spheres + shape.planes)]
        spheres = self._places(kinds[: shape.spheres])
        planes = self._places(kinds[shape.spheres :])
        lights = self._places([shape.falloff(i) for i in range(shape.lights)])
        materials = [*spheres, *(shape.spheres + place for place in planes)]
        places = {"sphere": spheres, "plane": planes, "light": lights, "m": materials}
        return {_renamed(name, places): value for name, value in numbers.items()}

    def _places(self, kinds):
        places = np.arange(len(kinds))
        for kind in set(kinds):
            alike = [i for i, other in enumerate(kinds) if other == kind]
            places[alike] = self.order.permutation(alike)
        return places.tolist()


def _renamed(name, places):
    group, *rest = name.split(".")
    if len(rest) < 2:
        return name
    kind = rest[0].rstrip("0123456789")
    return f"{group}.{kind}{places[kind][int(rest[0][len(kind) :])]}.{rest[1]}"


def random_similarity(seed, rotation):
    """A shift, scale and order by chance; the rotation is given, as a camera's `up` is compiled."""
    rng = np.random.default_rng(seed)
    return Similarity(rotation, 10 ** rng.uniform(-1, 1), rng.normal(size=3), rng)


def random_rotation(seed):
    """A rotation, by the QR decomposition of a matrix of normal numbers."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def with_up(loaded, up):
    """The scene with another direction up."""
    return replace(loaded, camera=replace(loaded.camera, up=tuple(up.tolist())))
