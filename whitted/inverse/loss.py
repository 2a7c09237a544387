"""How far images of a scene are from their targets, and how that changes with the scene's
parameters.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array
from ..rendering.samples import render_samples
from ..scene.scene import Scene


@dataclass(frozen=True)
class View:
    """A scene, and what its image should be."""

    scene: Scene
    target: np.ndarray  # (height, width, 3)
    weight: np.ndarray  # (height, width, 1), what a pixel counts for

    @property
    def resolution(self) -> tuple[int, int]:
        return self.target.shape[1], self.target.shape[0]

    def halved(self) -> "View":
        """The view at half the resolution: a pixel is a mean over its area, so the target's is the
        mean of four.
        """
        height, width = (n // 2 * 2 for n in self.target.shape[:2])

        def means(image: np.ndarray) -> np.ndarray:
            return image[:height, :width].reshape(height // 2, 2, width // 2, 2, -1).mean((1, 3))

        weight = means(self.weight)
        target = means(self.target * self.weight) / np.where(weight > 0, weight, 1)
        return replace(self, target=target, weight=weight)


def view(
    scene: Scene, target: object, mask: object, resolution: tuple[int, int] | None, where: str
) -> View:
    """A checked view.

    Args:
        target: linear RGB of shape (height, width, 3), a Dr.Jit tensor or what NumPy takes for an
            array.
        mask: what each pixel counts for, >= 0, of shape (height, width), or None for all alike.
        where: a name for messages.

    Raises:
        ValueError: a target or a mask of another size, with values that are not numbers, or with
            nothing left to fit.
    """
    width, height = scene.resolution if resolution is None else resolution
    pixels = _numbers(target, f"{where}target")
    if pixels.shape != (height, width, 3):
        raise ValueError(
            f"{where}target: expected an image of {width} x {height} pixels, the scene's resolution, got shape {pixels.shape}; "
            "scale the target, or name its resolution"
        )
    weight = np.ones((height, width))
    if mask is not None:
        weight = _numbers(mask, f"{where}mask")
        if weight.shape != (height, width):
            raise ValueError(
                f"{where}mask: expected shape {(height, width)}, that of the target, got {weight.shape}"
            )
        if not (np.isfinite(weight).all() and (weight >= 0).all() and weight.any()):
            raise ValueError(f"{where}mask: expected weights >= 0 that are not all 0")
    bad = ~np.isfinite(pixels).all(axis=2) & (weight > 0)
    if bad.any():
        y, x = np.argwhere(bad)[0]
        raise ValueError(
            f"{where}target: {bad.sum()} pixels are not finite numbers, the first at x {x}, y {y}; mask them out"
        )
    number = scene.precision.dtype
    pixels = np.where(weight[:, :, None] > 0, pixels, 0)
    return View(scene, pixels.astype(number), weight[:, :, None].astype(number))


def _numbers(image: object, where: str) -> np.ndarray:
    try:
        return np.asarray(image.numpy() if hasattr(image, "numpy") else image, np.float64)
    except (TypeError, ValueError):
        raise ValueError(
            f"{where}: expected an array of numbers, got {type(image).__name__}"
        ) from None


@dataclass(frozen=True)
class Objective:
    """Half the weighted mean square of residuals over the pixels of all views, by a vector of all
    numbers that are fitted.
    """

    views: tuple[View, ...]
    names: tuple[str, ...]
    sizes: tuple[int, ...]  # numbers in each parameter
    options: dict[str, Any]  # of `render`
    gain: bool  # each channel may be brighter by a factor of its own

    @property
    def count(self) -> int:
        return sum(self.sizes)

    @property
    def total(self) -> float:
        """The weights of all channels of all pixels."""
        return 3 * sum(float(view.weight.sum()) for view in self.views)

    def halved(self) -> "Objective":
        return replace(self, views=tuple(view.halved() for view in self.views))

    def parameters(self, x: np.ndarray) -> dict[str, Any]:
        """The parameters with the numbers of a vector, for `Scene.replace`."""
        return split(dict(zip(self.names, map(np.zeros, self.sizes), strict=True)), x)

    def labels(self) -> list[str]:
        """A name for each number."""
        sizes = zip(self.names, self.sizes, strict=True)
        return [
            name if size == 1 else f"{name}.{'xyz'[k]}" for name, size in sizes for k in range(size)
        ]

    def images(self, x: np.ndarray) -> list[np.ndarray]:
        """The images of all views."""
        values = self.parameters(x)
        return [
            render_samples(
                view.scene.replace(values), resolution=view.resolution, **self.options
            ).numpy()
            for view in self.views
        ]

    def loss(self, x: np.ndarray) -> float:
        pairs = zip(self.views, self.images(x), strict=True)
        return (
            sum(self._residual(view, image.astype(np.float64))[2] for view, image in pairs)
            / self.total
            / 2
        )

    def gains(self, x: np.ndarray) -> np.ndarray:
        """The factor of each channel, shape (views, 3)."""
        return np.array(
            [
                self._residual(view, image)[1]
                for view, image in zip(self.views, self.images(x), strict=True)
            ]
        )

    def _residual(self, view: View, image: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Image less target, the best gain of each channel, and the weighted sum of the residual's
        squares.
        """
        gain = np.ones(3, image.dtype)
        if self.gain:
            power = (view.weight * image * image).sum((0, 1))
            gain = np.divide(
                (view.weight * image * view.target).sum((0, 1)), power, out=gain, where=power > 0
            )
        residual = gain * image - view.target if self.gain else image - view.target
        return residual, gain, float(np.vdot(view.weight * residual, residual))

    def gradient(self, values: dict[str, Array]) -> float:
        """The loss; its gradient is left in the parameters, Dr.Jit arrays for which gradients are
        enabled.
        """
        loss = 0.0
        for view in self.views:
            image = render_samples(
                view.scene.replace(values), resolution=view.resolution, **self.options
            )
            residual, gain, part = self._residual(view, image.numpy())
            loss += part / self.total / 2
            # The best gain is where the loss does not change with it
            seed = view.weight * residual * (gain / residual.dtype.type(self.total))
            dr.set_grad(image, type(image)(seed))
            dr.enqueue(dr.ADMode.Backward, image)
            dr.traverse(dr.ADMode.Backward)
        return loss

    def normal_equations(self, x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """The loss, its gradient, and the Gauss-Newton approximation of its second derivatives, by
        forward mode.
        """
        loss, slope, curvature = 0.0, np.zeros(self.count), np.zeros((self.count, self.count))
        for view in self.views:
            image, columns = self._jacobian(view, x)
            residual, gain, part = self._residual(view, image)
            jacobian = np.stack(
                [self._with_gain(view, image, column, gain) for column in columns], -1
            )
            weighted = (view.weight[..., None] * jacobian).reshape(-1, self.count)
            loss += part / 2
            slope += residual.ravel() @ weighted
            curvature += jacobian.reshape(-1, self.count).T @ weighted
        return loss / self.total, slope / self.total, curvature / self.total

    def _with_gain(
        self, view: View, image: np.ndarray, column: np.ndarray, gain: np.ndarray
    ) -> np.ndarray:
        """The derivative of gain * image, where the gain follows the image."""
        if not self.gain:
            return column
        power = (view.weight * image * image).sum((0, 1))
        change = (view.weight * column * (view.target - 2 * gain * image)).sum((0, 1))
        return gain * column + image * np.divide(change, power, out=np.zeros(3), where=power > 0)

    def _jacobian(self, view: View, x: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """A view's image, and its derivative by each number: one image is traced, and one
        derivative for each.
        """
        values = dr.detach(_arrays(view.scene, self.parameters(x)))
        dr.enable_grad(values)
        image = render_samples(
            view.scene.replace(values), resolution=view.resolution, **self.options
        )
        columns = []
        for name, size in zip(self.names, self.sizes, strict=True):
            for axis in range(size):
                for other, value in values.items():
                    unit = [
                        float(other == name and k == axis)
                        for k in range(3 if dr.depth_v(value) == 2 else 1)
                    ]
                    dr.set_grad(value, type(value)(*unit))
                dr.enqueue(dr.ADMode.Forward, values)
                dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearInterior)
                columns.append(dr.grad(image).numpy().astype(np.float64))
                dr.clear_grad(image)
        return image.numpy().astype(np.float64), columns


def split(like: Mapping[str, Any], x: np.ndarray) -> dict[str, Any]:
    """The numbers of a vector by name, as many for each as the values given."""
    parts = np.split(x, np.cumsum([np.size(value) for value in like.values()])[:-1])
    return {
        name: part.tolist() if len(part) > 1 else float(part[0])
        for name, part in zip(like, parts, strict=True)
    }


def _arrays(scene: Scene, values: dict[str, Any]) -> dict[str, Array]:
    """The Dr.Jit arrays of parameters."""
    types = {name: type(value) for name, value in scene.parameters(*values).items()}
    return {name: types[name](*np.ravel(value).tolist()) for name, value in values.items()}
