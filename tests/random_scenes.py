"""Scenes of a few layouts, as numbers: scenes of one layout share their kernels.

A scene is a dictionary from the name of a parameter to a NumPy number or vector, which `scene_of`
makes a scene of. `strategies.scenes` draws such dictionaries. Every sphere and every plane has a
material of its own, so that they can change places without a kernel of their own.
"""

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np
from gradcheck import as_type
from samples import camera, keys, light, material, plane, sphere

# It is compiled, and no camera of `strategies.scenes` looks along it
UP = np.array([0.13, 1.0, -0.21])


@dataclass(frozen=True)
class Layout:
    """What is compiled: how many there are of everything, and the kinds of materials and lights."""

    spheres: int
    planes: int
    lights: int
    fresnel: tuple[bool, ...] = (False, True)  # of the materials, in turns

    @property
    def materials(self):
        """For each material, first those of spheres, whether it obeys the Fresnel equations."""
        count = self.spheres + self.planes
        return [self.fresnel[i % len(self.fresnel)] for i in range(count)]

    @staticmethod
    def falloff(light):
        return ("none", "inverse-square")[light % 2]

    def text(self, numbers):
        """A scene file with these numbers."""

        def of(group, name):
            """The numbers of one thing."""
            prefix = f"{group}.{name}."
            return {key[len(prefix) :]: numbers[key] for key in numbers if key.startswith(prefix)}

        own = self.spheres
        return "".join(
            [
                keys(background=numbers["background"], ambient=numbers["ambient"]),
                camera(
                    numbers["camera.position"],
                    numbers["camera.look_at"],
                    numbers["camera.fov"],
                    (24, 24),
                    UP,
                ),
                *(
                    material(f"m{i}", fresnel=fresnel, **of("materials", f"m{i}"))
                    for i, fresnel in enumerate(self.materials)
                ),
                *(
                    sphere(**of("spheres", f"sphere{i}"), material=f"m{i}")
                    for i in range(self.spheres)
                ),
                *(
                    plane(**of("planes", f"plane{i}"), material=f"m{own + i}")
                    for i in range(self.planes)
                ),
                *(
                    light(**of("lights", f"light{i}"), falloff=self.falloff(i))
                    for i in range(self.lights)
                ),
            ]
        )

    @property
    def plain_text(self):
        """A scene file of this layout; its numbers are only there to be replaced."""
        numbers = {"background": [0, 0, 0], "ambient": [0, 0, 0], "camera.position": [0, 0, 5]}
        numbers |= {"camera.look_at": [0, 0, 0], "camera.fov": 50}
        for i in range(self.spheres):
            numbers |= {f"spheres.sphere{i}.center": [i, 0, 0], f"spheres.sphere{i}.radius": 0.3}
        for i in range(self.planes):
            numbers |= {f"planes.plane{i}.normal": [0, 1, 0], f"planes.plane{i}.offset": 2 + i}
        for i in range(self.lights):
            numbers |= {f"lights.light{i}.position": [1, 2, i]}
        return self.text(numbers)


LAYOUTS = {
    "nothing": Layout(0, 0, 0),
    "floor": Layout(0, 1, 1),
    "ball": Layout(1, 0, 2),
    "glass": Layout(3, 1, 1, (False,)),
    "mixed": Layout(5, 2, 2),
    "crowd": Layout(12, 0, 2, (True, False, False)),
}


def scene_of(loaded, numbers):
    """The scene with all of these numbers in place of its own."""
    old = loaded.parameters()
    values = {name: as_type(old[name], value) for name, value in numbers.items()}
    # Numbers that Dr.Jit knows would be part of kernels, those of `numpy()` among them
    dr.make_opaque(values)
    return loaded.replace(values)


def length_scale(numbers):
    """The largest coordinate or radius, of whose roundings positions are made."""
    lengths = ("center", "radius", "position", "look_at", "offset")
    return max(np.abs(own).max() for name, own in numbers.items() if name.endswith(lengths))


def jiggled(numbers, seed, amount, scale):
    """The scene with every length changed by up to `amount * scale`, and every direction and index
    by up to `amount`.
    """
    rng = np.random.default_rng(seed)
    sizes = dict.fromkeys(("center", "radius", "position", "look_at", "offset"), scale)
    sizes |= {"normal": 1, "ior": 1}
    moved = {}
    for name, value in numbers.items():
        size = sizes.get(name.rpartition(".")[2], 0)
        sign, part = rng.choice([-1, 1], np.shape(value)), rng.uniform(0.5, 1, np.shape(value))
        changed = value + sign * part * amount * size
        moved[name] = np.maximum(changed, value / 2) if name.endswith("radius") else changed
    return moved


@dataclass(frozen=True)
class Similarity:
    """x -> scale * rotation x + shift, and a new order of spheres, planes and lights."""

    rotation: np.ndarray
    scale: float
    shift: np.ndarray
    # Name without its number ("sphere", "plane", "light") to the new place of each
    places: dict[str, list[int]]

    def __call__(self, layout, numbers):
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
                normal = self.rotation @ numbers[name.replace("offset", "normal")]
                value = value * self.scale - normal @ self.shift
            elif field == "intensity" and self._falls_off(layout, name):
                value = value * self.scale**2
            moved[self._renamed(layout, name)] = value
        return moved

    @staticmethod
    def _falls_off(layout, name):
        return layout.falloff(int(name.split(".")[1].removeprefix("light"))) == "inverse-square"

    def _renamed(self, layout, name):
        """The name of a thing in its new place; a material goes with what is made of it."""
        group, *rest = name.split(".")
        if len(rest) < 2:
            return name
        kind = rest[0].rstrip("0123456789")
        of_planes = [layout.spheres + place for place in self.places["plane"]]
        places = {**self.places, "m": [*self.places["sphere"], *of_planes]}[kind]
        return f"{group}.{kind}{places[int(rest[0].removeprefix(kind))]}.{rest[1]}"


def random_rotation(seed):
    """A rotation, by the QR decomposition of a matrix of normal numbers."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def with_up(scene, up):
    """The scene with another direction up."""
    return replace(scene, camera=replace(scene.camera, up=tuple(up.tolist())))
