"""Scenes as TOML text, their images, and derivatives of these in both modes."""

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Precision
from ..rendering.gradient import gradient
from ..rendering.samples import render_samples
from ..scene.files import load_scene
from ..scene.scene import Scene
from .arrays import count
from .case import Check

# White surfaces, with the colour 1, have the radiance 1 in this light
WHITE_AMBIENT = "ambient = [1, 1, 1]\n"
WHITE_SKY = "background = [1, 1, 1]\n"


def scene_of(p: Precision, *parts: str) -> Scene:
    """The scene of a file that consists of these parts."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text("".join(parts))
        return load_scene(path, p.name)


def camera(
    position: Any, look_at: Any, fov: float, size: tuple[int, int], up: Any = (0, 1, 0)
) -> str:
    return _table(
        "[camera]",
        position=list(position),
        look_at=list(look_at),
        fov=fov,
        resolution=list(size),
        up=list(up),
    )


def material(name: str, **fields: Any) -> str:
    return _table(f"[materials.{name}]", **fields)


def ball(name: str, center: Any, radius: float, made_of: str) -> str:
    return _table(
        "[[spheres]]", name=f'"{name}"', center=list(center), radius=radius, material=f'"{made_of}"'
    )


def wall(name: str, normal: Any, offset: float, made_of: str) -> str:
    return _table(
        "[[planes]]", name=f'"{name}"', normal=list(normal), offset=offset, material=f'"{made_of}"'
    )


def lamp(position: Any, intensity: Any = (1, 1, 1)) -> str:
    """A point light named "lamp", without falloff."""
    return _table("[[lights]]", name='"lamp"', position=list(position), intensity=list(intensity))


def _table(header: str, **fields: Any) -> str:
    return header + "\n" + "".join(f"{key} = {value}\n" for key, value in fields.items())


WHITE = material("white", color=[1, 1, 1])
GLASS = material("glass", reflection=1, refraction=1, ior=1.5, fresnel="true")
# Glass that only refracts
CLEAR = material("clear", refraction=1, ior=1.5)
# A single pixel around the ray from (0, 0, 5) along -z
PIXEL = camera((0, 0, 5), (0, 0, 0), 1, (1, 1))


@dataclass(frozen=True)
class Disc:
    """The image of a sphere on the camera's axis: its area in pixels, and derivatives of it."""

    area: float
    by_radius: float
    by_distance: float


def disc(distance: float, radius: float, side: int, fov: float) -> Disc:
    """The silhouette of a sphere on the camera's axis: pi f^2 r^2 / (d^2 - r^2) pixels.

    Args:
        distance: d, from the camera to the sphere's centre.
        radius: r.
        side: pixels along a side of the image; f is the focal length in pixels.
        fov: in degrees.
    """
    f2 = (side / 2 / math.tan(math.radians(fov) / 2)) ** 2
    r2, d2 = radius**2, distance**2
    factor = 2 * math.pi * f2 * radius * distance / (d2 - r2) ** 2
    return Disc(math.pi * f2 * r2 / (d2 - r2), factor * distance, -factor * radius)


def white_ball(
    p: Precision, distance: float, radius: float, side: int, fov: float
) -> tuple[Scene, Disc]:
    """A sphere "ball" at the origin, of radiance 1 before black: the scene, and its silhouette."""
    view = camera((0, 0, distance), (0, 0, 0), fov, (side, side))
    scene = scene_of(p, WHITE_AMBIENT, view, WHITE, ball("ball", (0, 0, 0), radius, "white"))
    return scene, disc(distance, radius, side, fov)


def picture(scene: Scene, spp: int = 1, **options: Any) -> np.ndarray:
    """The image as float64, of plain samples unless `boundary` is given."""
    return render_samples(scene, spp, **{"boundary": False, **options}).numpy().astype(np.float64)


def total(image: np.ndarray) -> float:
    """The sum over all pixels of the mean of the channels."""
    return float(image.sum() / 3)


def forward(
    scene: Scene, name: str, component: str | None = None, spp: int = 1, **options: Any
) -> np.ndarray:
    """The derivative of the image as float64, in forward mode."""
    options = {"boundary": False, **options}
    return gradient(scene, name, component, spp, **options).numpy().astype(np.float64)


def reverse(scene: Scene, *names: str, spp: int = 1, **options: Any) -> dict[str, np.ndarray]:
    """Derivatives of the sum over all pixels and channels, in reverse mode.

    Args:
        names: of parameters; all if there are none.
    """
    params = scene.parameters(*names)
    dr.enable_grad(params)
    image = render_samples(scene.replace(params), spp, **{"boundary": False, **options})
    dr.backward(dr.sum(image.array))
    return {
        name: np.ravel(dr.grad(value).numpy()).astype(np.float64) for name, value in params.items()
    }


def slope_checks(
    scene: Scene,
    name: str,
    component: str | None,
    expected: float,
    bound: float,
    spp: int = 1,
    **options: Any,
) -> list[Check]:
    """Check the derivative of the image's total, in both modes.

    Args:
        expected: the right derivative.
        bound: of the relative error, or of the error itself if 0 is expected.
    """
    by_forward = total(forward(scene, name, component, spp, **options))
    index = "xyz".index(component) if component else 0
    by_reverse = reverse(scene, name, spp=spp, **options)[name][index] / 3
    number = f"{name}.{component}" if component else name
    scale = abs(expected) or 1.0
    return [
        Check(f"d image / d {number}, {mode}", abs(value - expected) / scale, bound)
        for mode, value in (("forward", by_forward), ("reverse", by_reverse))
    ]


def finite_checks(
    scene: Scene, what: str, wrt: str, component: str | None = None, **options: Any
) -> list[Check]:
    """Count NaN and infinity in the image and its derivatives: none is allowed.

    The derivatives are those by one parameter in forward mode and by all in reverse mode.
    """
    groups = {
        "image": picture(scene, **options),
        "forward": forward(scene, wrt, component, **options),
        "reverse": np.concatenate(list(reverse(scene, **options).values())),
    }
    return [
        Check(f"{what}: NaN or infinite, {name}", count(~np.isfinite(values)), 0)
        for name, values in groups.items()
    ]
