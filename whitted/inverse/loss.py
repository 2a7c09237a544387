"""How far images are from their targets, and the derivatives of that by a scene's parameters."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array
from ..core.host import to_array
from ..rendering.samples import render_samples
from ..scene.scene import Scene
from .views import View


@dataclass(frozen=True)
class Objective:
    """Half the weighted mean square of the residuals, over the pixels of all views.

    It is a function of x, a vector of all numbers that are fitted.
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

    def render(self, view: View, values: Mapping[str, Any]) -> Array:
        """A view's image with these values of the parameters."""
        scene = view.scene.replace(values)
        return render_samples(scene, resolution=view.resolution, **self.options)

    def _images(self, x: np.ndarray) -> Iterator[tuple[View, np.ndarray]]:
        """All views and their images."""
        values = self.parameters(x)
        images = [self.render(view, values).numpy() for view in self.views]
        return zip(self.views, images, strict=True)

    def loss(self, x: np.ndarray) -> float:
        parts = (self._residual(view, image.astype(float))[2] for view, image in self._images(x))
        return sum(parts) / self.total / 2

    def gains(self, x: np.ndarray) -> np.ndarray:
        """The factor of each channel, shape (views, 3)."""
        return np.array([self._residual(view, image)[1] for view, image in self._images(x)])

    def residuals(self, x: np.ndarray) -> list[np.ndarray]:
        """Each view's residual, shape (height, width, 3), as far as its pixels count.

        Among pixels that count for different amounts, those that count for most have all of it.
        """
        parts = (
            (view, self._residual(view, image.astype(float))[0]) for view, image in self._images(x)
        )
        return [residual * np.sqrt(view.weight / view.weight.max()) for view, residual in parts]

    def sampling_errors(self, x: np.ndarray, left: Sequence[np.ndarray]) -> list[np.ndarray]:
        """What plain samples, as many as the fit's, would change in each view's residual.

        Where the fit has plain samples itself, its pictures are held against such with four times
        as many.

        Args:
            left: the residuals.
        """
        plain = {**self.options, "boundary": False}
        if self.options["boundary"]:
            others = replace(self, options=plain).residuals(x)
        else:
            others = replace(self, options={**plain, "spp": 4 * self.options["spp"]}).residuals(x)
        return [other - own for other, own in zip(others, left, strict=True)]

    def _residual(self, view: View, image: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """The residual, the best gain of each channel, and the weighted sum of squares.

        The residual is the image, times the gain, less the target.
        """
        gain = np.ones(3, image.dtype)
        if self.gain:
            power = (view.weight * image * image).sum((0, 1))
            product = (view.weight * image * view.target).sum((0, 1))
            np.divide(product, power, out=gain, where=power > 0)
        residual = gain * image - view.target if self.gain else image - view.target
        return residual, gain, float(np.vdot(view.weight * residual, residual))

    def gradient(self, values: dict[str, Array]) -> float:
        """The loss; its gradient is left in the parameters.

        Args:
            values: name to a Dr.Jit array for which gradients are enabled.
        """
        loss = 0.0
        for view in self.views:
            image = self.render(view, values)
            residual, gain, part = self._residual(view, image.numpy())
            loss += part / self.total / 2
            # The loss does not change with the gain, since that is the best one
            seed = view.weight * residual * (gain / residual.dtype.type(self.total))
            dr.set_grad(image, type(image)(to_array(seed.ravel(), seed.size), seed.shape))
            dr.backward_from(image)
        return loss

    def normal_equations(self, x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """The loss, its gradient and an approximation of its second derivatives, by forward mode.

        The approximation is Gauss and Newton's.
        """
        loss, slope, curvature = 0.0, np.zeros(self.count), np.zeros((self.count, self.count))
        for view, residual, jacobian in self.linearised(x):
            weighted = (view.weight[..., None] * jacobian).reshape(-1, self.count)
            loss += float(np.vdot(view.weight * residual, residual)) / 2
            slope += residual.ravel() @ weighted
            curvature += jacobian.reshape(-1, self.count).T @ weighted
        return loss / self.total, slope / self.total, curvature / self.total

    def linearised(self, x: np.ndarray) -> Iterator[tuple[View, np.ndarray, np.ndarray]]:
        """Each view, its residual, and the derivative of that by each number along a fourth axis.

        The residual has the shape (height, width, 3).
        """
        for view in self.views:
            image, columns = self._jacobian(view, x)
            residual, gain, _ = self._residual(view, image)
            columns = [self._with_gain(view, image, column, gain) for column in columns]
            yield view, residual, np.stack(columns, -1)

    def _with_gain(
        self, view: View, image: np.ndarray, column: np.ndarray, gain: np.ndarray
    ) -> np.ndarray:
        """The derivative of gain * image; the gain changes with the image."""
        if not self.gain:
            return column
        power = (view.weight * image * image).sum((0, 1))
        change = (view.weight * column * (view.target - 2 * gain * image)).sum((0, 1))
        return gain * column + image * np.divide(change, power, out=np.zeros(3), where=power > 0)

    def _jacobian(self, view: View, x: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """A view's image, and its derivative by each number.

        One image is traced, and one derivative for each number.
        """
        values = arrays(view.scene, self.parameters(x))
        dr.enable_grad(values)
        image = self.render(view, values)
        columns = []
        for name, size in zip(self.names, self.sizes, strict=True):
            for axis in range(size):
                for other, length in zip(self.names, self.sizes, strict=True):
                    unit = [float(other == name and k == axis) for k in range(length)]
                    dr.set_grad(values[other], type(values[other])(*unit))
                column = dr.forward_to(image, flags=dr.ADFlag.ClearInterior)
                columns.append(column.numpy().astype(np.float64))
                dr.clear_grad(image)
        return image.numpy().astype(np.float64), columns


def split(like: Mapping[str, Any], x: np.ndarray) -> dict[str, Any]:
    """The numbers of a vector by name; each name gets as many as its value has."""
    parts = np.split(x, np.cumsum([np.size(value) for value in like.values()])[:-1])
    return {
        name: part.tolist() if len(part) > 1 else float(part[0])
        for name, part in zip(like, parts, strict=True)
    }


def arrays(scene: Scene, values: Mapping[str, Any]) -> dict[str, Array]:
    """Parameters as Dr.Jit arrays of a scene's types."""
    types = {name: type(value) for name, value in scene.parameters(*values).items()}
    return {name: types[name](*np.ravel(value).tolist()) for name, value in values.items()}
