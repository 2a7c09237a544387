"""Scenes of the hard cases as text, their images, and derivatives of these in both modes."""

import tempfile
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Precision
from ..rendering.gradient import gradient
from ..rendering.samples import render_samples
from ..scene.files import load_scene
from ..scene.scene import Scene
from .case import Check, count

GLOW = "ambient = [1, 1, 1]\n"
SKY = "background = [1, 1, 1]\n"


def scene_of(p: Precision, *parts: str) -> Scene:
    """The scene of a file that consists of these parts."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text("".join(parts))
        return load_scene(path, p.name)


def camera(
    position: Any, look_at: Any, fov: float, size: tuple[int, int], up: Any = (0, 1, 0)
) -> str:
    resolution = f"fov = {fov}\nresolution = {list(size)}\nup = {list(up)}\n"
    return f"[camera]\nposition = {list(position)}\nlook_at = {list(look_at)}\n{resolution}"


def material(name: str, **fields: Any) -> str:
    return f"[materials.{name}]\n" + "".join(f"{key} = {value}\n" for key, value in fields.items())


def ball(name: str, center: Any, radius: float, of: str) -> str:
    return f'[[spheres]]\nname = "{name}"\ncenter = {list(center)}\nradius = {radius}\nmaterial = "{of}"\n'


def wall(name: str, normal: Any, offset: float, of: str) -> str:
    return f'[[planes]]\nname = "{name}"\nnormal = {list(normal)}\noffset = {offset}\nmaterial = "{of}"\n'


def lamp(position: Any, intensity: Any = (1, 1, 1)) -> str:
    return (
        f'[[lights]]\nname = "lamp"\nposition = {list(position)}\nintensity = {list(intensity)}\n'
    )


WHITE = material("white", color=[1, 1, 1])
GLASS = material("glass", reflection=1, refraction=1, ior=1.5, fresnel="true")


def picture(scene: Scene, spp: int = 1, **options: Any) -> np.ndarray:
    """The image in double, of plain samples unless `boundary` is given."""
    return render_samples(scene, spp, **{"boundary": False, **options}).numpy().astype(np.float64)


def forward(
    scene: Scene, name: str, component: str | None = None, spp: int = 1, **options: Any
) -> np.ndarray:
    """The derivative of the image in forward mode."""
    return (
        gradient(scene, name, component, spp, **{"boundary": False, **options})
        .numpy()
        .astype(np.float64)
    )


def reverse(scene: Scene, *names: str, spp: int = 1, **options: Any) -> dict[str, np.ndarray]:
    """The derivatives of the sum over all pixels and channels in reverse mode, by these parameters
    or by all.
    """
    params = scene.parameters(*names)
    dr.enable_grad(params)
    dr.backward(
        dr.sum(render_samples(scene.replace(params), spp, **{"boundary": False, **options}).array)
    )
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
    """The derivative of the sum over pixels of the mean channel, in both modes, relative to what is
    expected.
    """
    ahead = forward(scene, name, component, spp, **options).sum() / 3
    back = (
        reverse(scene, name, spp=spp, **options)[name]["xyz".index(component) if component else 0]
        / 3
    )
    number = f"{name}.{component}" if component else name
    scale = abs(expected) or 1.0
    return [
        Check(f"d image / d {number}, {mode}", abs(value - expected) / scale, bound)
        for mode, value in (("forward", ahead), ("reverse", back))
    ]


def finite_checks(
    scene: Scene, what: str, wrt: str, component: str | None = None, **options: Any
) -> list[Check]:
    """Numbers that are not finite: of the image, one derivative in forward mode, and all in
    reverse.
    """
    image = picture(scene, **options)
    ahead = forward(scene, wrt, component, **options)
    back = np.concatenate(list(reverse(scene, **options).values()))
    groups = (("image", image), ("forward", ahead), ("reverse", back))
    return [
        Check(f"{what}: not finite, {name}", count(~np.isfinite(values)), 0)
        for name, values in groups
    ]
