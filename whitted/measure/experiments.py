"""What is measured for the charts of a scene: images, gradients, and how time grows with what a
scene has.
"""

import math
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array
from ..inverse.bounds import scales_of, start_of
from ..lights import Light, PointLight
from ..rendering.gradient import gradient
from ..rendering.samples import render_samples
from ..scene.features import may
from ..scene.files import load_scene
from ..scene.scene import Scene
from ..shapes import Shape, Sphere
from .store import Rows, in_turns

# Numbers of what is added to a scene
COUNTS = (1, 2, 4, 8, 16)


class Experiments:
    """All measurements of a scene.

    Args:
        path: the scene file.
        size: width and height of the images whose errors are measured.
        quick: fewer samples, rounds and sizes.
    """

    def __init__(self, path: Path, size: tuple[int, int], quick: bool) -> None:
        self.path, self.size, self.quick = path, size, quick
        self.rounds = 3 if quick else 7
        self.scenes = {precision: load_scene(path, precision) for precision in ("single", "double")}

    @property
    def groups(self) -> dict[str, Callable[[], Rows]]:
        """Each group of measurements by its name, in the order in which they are best made."""
        return {
            "image": self.image,
            "depth": self.depth,
            "importance": self.importance,
            "gradient": self.gradient,
            "modes": self.modes,
            "pixels": self.pixels,
            "spheres": self.spheres,
            "lights": self.lights,
            "parameters": self.parameters,
            "memory": self.memory,
        }

    def _render(self, precision: str = "single", **options: Any) -> Array:
        return render_samples(self.scenes[precision], resolution=self.size, **options)

    @cached_property
    def reference(self) -> np.ndarray:
        """Plain samples, many of them, in double precision."""
        return self._render("double", spp=256 if self.quick else 1024, boundary=False).numpy()

    def image(self) -> Rows:
        """Plain samples, edges, both precisions: error and time."""
        plain = (1, 4, 16, 64) if self.quick else (1, 4, 16, 64, 256)
        settings = [("plain", "single", spp, False) for spp in plain] + [
            ("boundary", "single", spp, True) for spp in (1, 4, 16)
        ]
        settings += [("plain, float64", "double", spp, False) for spp in (1, 16)]
        settings += [("boundary, float64", "double", spp, True) for spp in (1, 4)]
        calls = {
            f"{s[0]}, spp {s[2]}": partial(self._render, s[1], spp=s[2], boundary=s[3])
            for s in settings
        }
        rows = self._images(calls, self.reference)
        for row, (kind, _, spp, _) in zip(rows, settings, strict=True):
            row |= {"kind": kind, "spp": spp}
        floor = self._render("double", spp=36 if self.quick else 64).numpy()
        return [
            *rows,
            {
                "kind": "floor",
                "name": "error of the reference",
                "error": relative(floor, self.reference),
            },
        ]

    def depth(self) -> Rows:
        """What chains of rays that are cut short cost and lose."""
        deepest = max(2, min(8, self.scenes["single"].max_depth))
        calls = {
            f"depth {d}": partial(self._render, spp=4, max_depth=d) for d in range(1, deepest + 1)
        }
        rows = self._images(calls, self.reference)
        return [row | {"depth": d} for d, row in enumerate(rows, 1)]

    def importance(self) -> Rows:
        """What children too faint to be traced cost and lose."""
        least = (0.0, 0.03, 0.1, 0.3)
        scenes = [replace(self.scenes["single"], min_importance=value) for value in least]
        calls = {
            f"min_importance {value:g}": partial(render_samples, scene, 4, resolution=self.size)
            for value, scene in zip(least, scenes, strict=True)
        }
        return [
            row | {"least": value}
            for row, value in zip(self._images(calls, self.reference), least, strict=True)
        ]

    def _images(self, calls: Mapping[str, Callable[[], Array]], reference: np.ndarray) -> Rows:
        found = in_turns(calls, self.rounds)
        return [
            {"name": name, "error": relative(row.pop("value").numpy(), reference), **row}
            for name, row in found.items()
        ]

    def subject(self) -> tuple[str, str | None]:
        """The parameter whose derivative is charted: an index if some sphere has one that matters,
        or else a position.
        """
        scene = self.scenes["single"]
        spheres = [shape for shape in scene.shapes if isinstance(shape, Sphere)]
        materials = {material.name: material for material in scene.materials}
        for sphere in spheres:
            if may(scene, materials[sphere.material], "refraction"):
                return f"materials.{sphere.material}.ior", None
        return (f"spheres.{spheres[0].name}.center" if spheres else "camera.position"), "x"

    def gradient(self) -> Rows:
        """The derivative's image by one parameter: plain, with edges, and by differences; then all
        parameters at once.
        """
        name, component = self.subject()
        exact, step = self._differences("double", 64), self.step
        reference = self.derivative
        calls: dict[str, Callable[[], Any]] = {}
        for kind, boundary in (("plain AD", False), ("boundary", True)):
            for spp in (1, 4, 16):
                options: dict[str, Any] = {"boundary": boundary, "resolution": self.size}
                calls[f"{kind}, spp {spp}"] = partial(
                    gradient, self.scenes["single"], name, component, spp, **options
                )
        calls["boundary, float64, spp 4"] = partial(
            gradient, self.scenes["double"], name, component, 4, resolution=self.size
        )
        for factor in (0.3, 0.1, 0.03, 0.01):
            for spp in (4, 16):
                calls[f"differences, step {factor:g}, spp {spp}"] = partial(
                    self._differences("single", spp, False), factor * step
                )
        found = in_turns(calls, self.rounds)
        rows = []
        for label, row in found.items():
            value = row.pop("value")
            pixels = value if isinstance(value, np.ndarray) else value.numpy()
            rows.append(
                {
                    "name": label,
                    "kind": label.split(",")[0],
                    "error": relative(pixels, reference),
                    **row,
                }
            )
        rows.append(
            {
                "kind": "floor",
                "name": "error of the reference",
                "error": relative(exact(1e-3 * step), reference),
            }
        )
        return rows

    @property
    def step(self) -> float:
        """A large change of the parameter whose derivative is charted."""
        return float(scales_of(self.scenes["double"], [self.subject()[0]])[0])

    @cached_property
    def derivative(self) -> np.ndarray:
        """The image of its derivative, by differences of many samples in double precision."""
        return self._differences("double", 64)(5e-4 * self.step)

    def modes(self) -> Rows:
        """Forward and reverse mode, by one parameter and by all: the derivative's part along the
        reference, which should be 1.
        """
        name, component = self.subject()
        along = self.derivative / np.sum(self.derivative**2)
        calls: dict[str, Callable[[], float]] = {}
        for kind, boundary in (("plain AD", False), ("boundary", True)):
            for precision in ("single", "double") if boundary else ("single",):
                scene = self.scenes[precision]
                for spp in (1, 4):
                    options: dict[str, Any] = {"boundary": boundary, "resolution": self.size}
                    end = f"{precision}, spp {spp}"
                    calls[f"{kind}, forward, {end}"] = partial(
                        _forward, scene, name, component, spp, along, options
                    )
                    for what, names in (
                        ("one", [name]),
                        ("all", sorted({name, *scene.features.live})),
                    ):
                        call = partial(
                            _reverse, scene, names, (name, component), spp, along, options
                        )
                        calls[f"{kind}, reverse, {what}, {end}"] = call
        found = in_turns(calls, self.rounds)
        return [
            {
                "name": label,
                "kind": label.rsplit(", ", 2)[0],
                "error": abs(row.pop("value") - 1),
                **row,
            }
            for label, row in found.items()
        ]

    def _differences(
        self, precision: str, spp: int, boundary: bool = True
    ) -> Callable[[float], np.ndarray]:
        """A function of the step, which takes central differences."""
        scene = self.scenes[precision]
        name, component = self.subject()
        value = start_of(scene, name)
        direction = np.zeros(len(value))
        direction["xyz".index(component) if component else 0] = 1

        def difference(step: float) -> np.ndarray:
            ends = [
                scene.replace({name: (value + sign * step * direction).tolist()})
                for sign in (1, -1)
            ]
            images = [
                render_samples(end, spp, boundary=boundary, resolution=self.size)
                .numpy()
                .astype(np.float64)
                for end in ends
            ]
            return (images[0] - images[1]) / (2 * step)

        return difference

    def pixels(self) -> Rows:
        """Time against pixels."""
        scene, sides = (
            self.scenes["single"],
            (64, 128, 256, 512) if self.quick else (64, 128, 256, 512, 1024),
        )
        rows = []
        for kind, boundary in (("plain", False), ("boundary", True)):
            calls = {
                f"{kind}, {n} x {n}": partial(
                    render_samples, scene, boundary=boundary, resolution=(n, n)
                )
                for n in sides
            }
            rows += [
                row | {"kind": kind, "x": n * n}
                for n, row in zip(sides, self._times(calls), strict=True)
            ]
        return rows

    def spheres(self) -> Rows:
        """Time, compile time and operations against spheres."""
        scene = self.scenes["single"]
        return self._grown(
            [
                (n, replace(scene, shapes=(*more_spheres(scene, n), *scene.shapes)))
                for n in self._counts
            ]
        )

    def lights(self) -> Rows:
        """The same against lights."""
        scene = self.scenes["single"]
        return self._grown(
            [
                (n, replace(scene, lights=(*scene.lights, *more_lights(scene, n))))
                for n in self._counts
            ]
        )

    @property
    def _counts(self) -> tuple[int, ...]:
        return COUNTS[:4] if self.quick else COUNTS

    def _grown(self, scenes: list[tuple[int, Scene]]) -> Rows:
        calls = {
            f"{n} more": partial(render_samples, scene, boundary=False, resolution=(256, 256))
            for n, scene in scenes
        }
        return [
            row | {"kind": "plain", "x": n}
            for (n, _), row in zip(scenes, self._times(calls), strict=True)
        ]

    def parameters(self) -> Rows:
        """The time of a gradient in reverse and in forward mode against the number of parameters."""
        scene = self.scenes["single"]
        names = sorted(scene.features.live)
        counts = sorted({1, 3, 10, len(names)} & set(range(1, len(names) + 1)))

        def reverse(count: int) -> Any:
            values = dr.detach(scene.parameters(*names[:count]))
            dr.enable_grad(values)
            dr.backward(
                dr.mean(
                    dr.square(render_samples(scene.replace(values), resolution=self.size)),
                    axis=None,
                )
            )
            return dr.grad(values)

        def forward(count: int) -> Any:
            return [self._tangent(name) for name in names[: min(count, 3)]]

        rows = self._times({f"reverse, {n} parameters": partial(reverse, n) for n in counts})
        rows = [
            row | {"kind": "reverse mode, all at once", "x": n}
            for n, row in zip(counts, rows, strict=True)
        ]
        few = [n for n in counts if n <= 3]
        ahead = self._times({f"forward, {n} parameters": partial(forward, n) for n in few})
        return rows + [
            row | {"kind": "forward mode, one by one", "x": n}
            for n, row in zip(few, ahead, strict=True)
        ]

    def _tangent(self, name: str) -> Array:
        vector = len(start_of(self.scenes["single"], name)) > 1
        return gradient(self.scenes["single"], name, "x" if vector else None, resolution=self.size)

    def _times(self, calls: Mapping[str, Callable[[], Any]]) -> Rows:
        found = in_turns(calls, self.rounds)
        return [
            {"name": name, **{key: value for key, value in row.items() if key != "value"}}
            for name, row in found.items()
        ]

    def memory(self) -> Rows:
        """The most memory that a process holds which renders one image."""
        sides = (256, 1024) if self.quick else (256, 1024, 2048)
        rows = []
        for kind, boundary in (("plain", False), ("boundary", True)):
            for n in sides:
                command = [
                    sys.executable,
                    "-m",
                    "whitted.measure.experiments",
                    str(self.path),
                    str(n),
                    str(int(boundary)),
                ]
                done = subprocess.run(command, capture_output=True, text=True, check=True)
                rows.append(
                    {
                        "name": f"{kind}, {n} x {n}",
                        "kind": kind,
                        "x": n * n,
                        "mib": float(done.stdout),
                    }
                )
        return rows


def _forward(
    scene: Scene, name: str, component: str | None, spp: int, along: np.ndarray, options: dict
) -> float:
    """The part of an image's derivative along another image, in forward mode."""
    return float(np.sum(gradient(scene, name, component, spp, **options).numpy() * along))


def _reverse(
    scene: Scene,
    names: list[str],
    wanted: tuple[str, str | None],
    spp: int,
    along: np.ndarray,
    options: dict,
) -> float:
    """The same in reverse mode, by all of these parameters at once, of which one is wanted."""
    values = dr.detach(scene.parameters(*names))
    dr.enable_grad(values)
    image = render_samples(scene.replace(values), spp, **options)
    dr.backward(dr.sum((image * type(image)(along)).array))
    name, component = wanted
    return float(
        np.ravel(dr.grad(values[name]).numpy())["xyz".index(component) if component else 0]
    )


def relative(image: np.ndarray, reference: np.ndarray) -> float:
    """RMSE over the reference's root mean square."""
    scale = float(np.sqrt(np.mean(reference**2)))
    error = float(np.sqrt(np.mean((image.astype(np.float64) - reference) ** 2)))
    return error / scale if scale else error


def more_spheres(scene: Scene, count: int) -> list[Shape]:
    """Small spheres of the scene's own materials, in a grid around what the camera looks at."""
    center, right = start_of(scene, "camera.look_at"), 0.1 * _distance(scene)
    across = math.ceil(math.sqrt(count))
    materials, precision = scene.used or scene.materials, scene.precision
    found = []
    for k in range(count):
        row, column = divmod(k, across)
        place = center + right * np.array([column - across / 2, row - across / 2, 0.5]) * 4 / across
        material = materials[k % len(materials)].name
        found.append(
            Sphere(
                f"more{k}",
                material,
                precision.vector(*place.tolist()),
                dr.opaque(precision.real, right / across),
            )
        )
    return found


def more_lights(scene: Scene, count: int) -> list[Light]:
    """Lights around the camera, as bright together as one of 1."""
    vector, place = scene.precision.vector, start_of(scene, "camera.position")
    random = np.random.default_rng(0)
    offsets = 0.2 * _distance(scene) * random.normal(size=(count, 3))
    bright = vector(1 / count)
    return [
        PointLight(f"more{k}", vector(*(place + offset).tolist()), bright, "none")
        for k, offset in enumerate(offsets)
    ]


def _distance(scene: Scene) -> float:
    return float(
        np.linalg.norm(start_of(scene, "camera.position") - start_of(scene, "camera.look_at"))
    )


if __name__ == "__main__":
    side = int(sys.argv[2])
    dr.eval(
        render_samples(
            load_scene(sys.argv[1]), boundary=sys.argv[3] == "1", resolution=(side, side)
        )
    )
    dr.sync_thread()
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
