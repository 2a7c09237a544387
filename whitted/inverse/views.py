"""What a fit looks at: scenes, and what their images should be."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..files.images import numbers, radiance
from ..scene.scene import Scene, checked_scene
from .noise import noise_variance

Resolution = tuple[int, int]
# What finitely many samples change in a target, as a part of it; where objects are to be found in
# spite of others, less than that is no reason to leave a pixel out
SAMPLES = 0.01


@dataclass(frozen=True)
class View:
    """A scene, and what its image should be."""

    scene: Scene
    target: np.ndarray  # (height, width, 3)
    weight: np.ndarray  # (height, width, 1): what a pixel counts for

    @property
    def resolution(self) -> Resolution:
        return self.target.shape[1], self.target.shape[0]

    @cached_property
    def variance(self) -> float:
        """Of the noise in a channel of a pixel; errors of samples are taken for such noise."""
        target = self.target.astype(float)
        return noise_variance(target) + SAMPLES**2 * float(np.mean(target**2))

    def halved(self) -> "View":
        """The view at half the resolution.

        A pixel is a mean over its area, so a pixel of the new target is a mean of four.
        """
        height, width = (n // 2 * 2 for n in self.target.shape[:2])

        def means(image: np.ndarray) -> np.ndarray:
            return image[:height, :width].reshape(height // 2, 2, width // 2, 2, -1).mean((1, 3))

        weight = means(self.weight)
        target = means(self.target * self.weight) / np.where(weight > 0, weight, 1)
        return replace(self, target=target, weight=weight)


def views_of(scene: Any, target: object, mask: object, resolution: Resolution | None) -> list[View]:
    """The views that `fit` is given: one scene with its target, or a list of pairs or triples.

    Raises:
        TypeError: they are neither.
        ValueError: there are none, or what `checked_view` refuses.
    """
    if isinstance(scene, str) or not isinstance(scene, Iterable):
        own = checked_scene(scene)
        if target is None:
            raise ValueError("target: expected an image, got None")
        return [checked_view(own, target, mask, resolution)]
    if target is not None or mask is not None:
        raise ValueError(
            "target: with several views, give each as (scene, target) or (scene, target, mask)"
        )
    views = list(scene)
    if not views:
        raise ValueError("scene: expected at least one pair (scene, target), got none")
    for k, one in enumerate(views):
        if not isinstance(one, tuple) or len(one) not in (2, 3):
            got = f"got a {type(one).__name__}"
            raise TypeError(f"view {k}: expected (scene, target) or (scene, target, mask), {got}")
        checked_scene(one[0], f"view {k}: scene")
    return [
        checked_view(one[0], one[1], one[2] if len(one) == 3 else None, resolution, f"view {k}: ")
        for k, one in enumerate(views)
    ]


def checked_view(
    scene: Scene, target: object, mask: object, resolution: Resolution | None, where: str = ""
) -> View:
    """A checked view.

    Args:
        target: linear RGB of shape (height, width, 3), a Dr.Jit tensor or what NumPy takes for an
            array.
        mask: what each pixel counts for, >= 0, of shape (height, width); None: all count alike.
        where: what messages begin with.

    Raises:
        ValueError: a target or a mask of another size, of integers, with values that are not
            numbers, or with nothing left to fit.
    """
    width, height = scene.resolution if resolution is None else resolution
    pixels = radiance(target, f"{where}target")
    if pixels.shape != (height, width, 3):
        raise ValueError(
            f"{where}target: expected an image of {width} x {height} pixels, the scene's "
            f"resolution, got shape {pixels.shape}; scale the target, or name its resolution"
        )
    weight = _weight(mask, (height, width), f"{where}mask")
    bad = ~np.isfinite(pixels).all(axis=2) & (weight > 0)
    if bad.any():
        y, x = np.argwhere(bad)[0]
        raise ValueError(
            f"{where}target: {bad.sum()} pixels are not finite numbers, the first at x {x}, y {y}; "
            "mask them out"
        )
    number = scene.precision.dtype
    pixels = np.where(weight[:, :, None] > 0, pixels, 0)
    return View(scene, pixels.astype(number), weight[:, :, None].astype(number))


def _weight(mask: object, shape: tuple[int, int], where: str) -> np.ndarray:
    """What each pixel counts for."""
    if mask is None:
        return np.ones(shape)
    weight = numbers(mask, where)
    if weight.dtype.kind in "iu":
        raise ValueError(
            f"{where}: integers ({weight.dtype}) are no weights; write mask > 0, or divide by 255"
        )
    if weight.shape != shape:
        raise ValueError(f"{where}: expected shape {shape}, that of the target, got {weight.shape}")
    if not (np.isfinite(weight).all() and (weight >= 0).all() and weight.any()):
        raise ValueError(f"{where}: expected weights >= 0 that are not all 0")
    return weight
