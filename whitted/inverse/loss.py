"""How far images are from their targets, and the derivatives of that by a scene's parameters."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import drjit as dr
import numpy as np

from ..core.arrays import Array
from ..core.host import to_array
from ..rendering.samples import Linearised, render_samples
from ..scene.parameters import as_parameter
from ..scene.scene import Scene
from .priors import Prior
from .robust import robust_loss, robust_weight
from .views import View

# Derivatives of pixels that are kept, at most: they take 128 MiB
KEPT = 1 << 24


@dataclass(frozen=True)
class Objective:
    """Half the weighted mean square of the residuals, over the pixels of all views.

    It is a function of x, a vector of all numbers that are fitted.
    """

    views: tuple[View, ...]
    names: tuple[str, ...]
    # Of each parameter: () of a number, (3,) of a vector, (N,) or (N, 3) of a cloud
    shapes: tuple[tuple[int, ...], ...]
    options: dict[str, Any]  # of `render`
    gain: bool  # each channel may be brighter by a factor of its own
    prior: Prior | None = None
    robust: str | None = None  # the name of a robust loss
    # The views' images of the last x, by its bytes
    _last: dict[bytes, list[Linearised]] = field(
        init=False, default_factory=dict, compare=False, repr=False
    )
    # The views' residuals and the derivatives of these, of the x for which they were made last
    _slopes: dict[bytes, list[tuple[np.ndarray, np.ndarray]]] = field(
        init=False, default_factory=dict, compare=False, repr=False
    )

    @property
    def sizes(self) -> tuple[int, ...]:
        """How many numbers each parameter has."""
        return tuple(map(math.prod, self.shapes))

    @property
    def count(self) -> int:
        return sum(self.sizes)

    @property
    def total(self) -> float:
        """The weights of all channels of all pixels."""
        return 3 * sum(float(view.weight.sum()) for view in self.views)

    @property
    def variance(self) -> float:
        """Of the noise in a channel of a pixel, on average over the views."""
        return float(np.mean([view.variance for view in self.views]))

    def halved(self) -> "Objective":
        return replace(self, views=tuple(view.halved() for view in self.views))

    def parameters(self, x: np.ndarray) -> dict[str, Any]:
        """The parameters with the numbers of a vector, for `Scene.replace`."""
        return split(dict(zip(self.names, map(np.zeros, self.shapes), strict=True)), x)

    def labels(self) -> list[str]:
        """A name for each number."""
        shapes = zip(self.names, self.shapes, strict=True)
        return [label_of(name, place) for name, shape in shapes for place in np.ndindex(shape)]

    def _at(self, x: np.ndarray) -> list[Linearised]:
        """All views' images, with derivatives in any directions; those of the last x are kept."""
        key = x.tobytes()
        if key not in self._last:
            self._last.clear()
            self._last[key] = [self._linearised(view, x) for view in self.views]
        return self._last[key]

    def _linearised(self, view: View, x: np.ndarray) -> Linearised:
        values = arrays(view.scene, self.parameters(x))
        dr.enable_grad(values)
        scene = view.scene.replace(values)
        return Linearised(scene, values, resolution=view.resolution, **self.options)

    def _images(self, x: np.ndarray) -> Iterator[tuple[View, np.ndarray]]:
        """All views and their images."""
        images = [linearised.image.numpy() for linearised in self._at(x)]
        return zip(self.views, images, strict=True)

    def loss(self, x: np.ndarray) -> float:
        parts = map(self._part, self.views, self.residuals(x))
        return (sum(parts) / 2 + self._prior_loss(x)) / self.total

    def _prior_loss(self, x: np.ndarray) -> float:
        return self.prior.loss(x) * self.variance if self.prior else 0.0

    def _part(self, view: View, residual: np.ndarray) -> float:
        """A view's weighted sum of squares, or of what counts in their place."""
        if self.robust is None:
            return float(np.vdot(view.weight * residual, residual))
        lost = robust_loss(self.robust, self._unusual(view, residual))
        return 3 * view.variance * float(np.vdot(view.weight, lost))

    @staticmethod
    def _unusual(view: View, residual: np.ndarray) -> np.ndarray:
        """The mean square over channels of a residual, in units of the noise."""
        return (residual**2).mean(2, keepdims=True) / view.variance

    def unusual_weight(self, view: View, residual: np.ndarray) -> np.ndarray:
        """The factor of each pixel's weight by a robust loss, shape (height, width, 1)."""
        assert self.robust is not None
        return robust_weight(self.robust, self._unusual(view, residual))

    def counted(self, view: View, residual: np.ndarray) -> np.ndarray:
        """What each pixel counts for, shape (height, width, 1); a robust loss lowers it."""
        if self.robust is None:
            return view.weight
        factor = self.unusual_weight(view, residual)
        return view.weight * factor.astype(view.weight.dtype)

    def gains(self, x: np.ndarray) -> np.ndarray:
        """The factor of each channel, shape (views, 3)."""
        if not self.gain:
            return np.ones((len(self.views), 3))
        return np.array([self._residual(view, image)[1] for view, image in self._images(x)])

    def residuals(self, x: np.ndarray) -> list[np.ndarray]:
        """Each view's residual, shape (height, width, 3)."""
        known = self._slopes.get(x.tobytes())
        if known is not None:
            return [residual for residual, _ in known]
        return [self._residual(view, image.astype(float))[0] for view, image in self._images(x)]

    def _residual(self, view: View, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The residual, and the best gain of each channel.

        The residual is the image, times the gain, less the target.
        """
        gain = np.ones(3, image.dtype)
        if self.gain:
            power = (view.weight * image * image).sum((0, 1))
            product = (view.weight * image * view.target).sum((0, 1))
            np.divide(product, power, out=gain, where=power > 0)
        residual = gain * image - view.target if self.gain else image - view.target
        return residual, gain

    def gradient(self, values: dict[str, Array]) -> float:
        """The loss; its gradient is left in the parameters.

        Args:
            values: name to a Dr.Jit array for which gradients are enabled.
        """
        loss = 0.0
        for view in self.views:
            scene = view.scene.replace(values)
            image = render_samples(scene, resolution=view.resolution, **self.options)
            residual, gain = self._residual(view, image.numpy())
            loss += self._part(view, residual) / 2
            # The loss does not change with the gain, since that is the best one
            counted = self.counted(view, residual) * residual
            seed = counted * (gain / residual.dtype.type(self.total))
            dr.set_grad(image, type(image)(to_array(seed.ravel(), seed.size), seed.shape))
            dr.backward_from(image)
        if self.prior is None:
            return loss / self.total
        x = numbers_in(values.values())
        slope = self.prior.slope(x) * self.variance / self.total
        for name, part in arrays(self.views[0].scene, self.parameters(slope)).items():
            dr.set_grad(values[name], dr.grad(values[name]) + part)
        return (loss + self._prior_loss(x)) / self.total

    def normal_equations(self, x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """The loss, its gradient and an approximation of its second derivatives, by forward mode.

        The approximation is Gauss and Newton's.
        """
        loss, slope, curvature = 0.0, np.zeros(self.count), np.zeros((self.count, self.count))
        for view, residual, jacobian in self.linearised(x):
            counted = self.counted(view, residual)[..., None]
            weighted = (counted * jacobian).reshape(-1, self.count)
            loss += self._part(view, residual) / 2
            slope += residual.ravel() @ weighted
            curvature += jacobian.reshape(-1, self.count).T @ weighted
        if self.prior is not None:
            loss += self._prior_loss(x)
            slope += self.prior.slope(x) * self.variance
            curvature += np.diag(self.prior.precision * self.variance)
        return loss / self.total, slope / self.total, curvature / self.total

    def linearised(self, x: np.ndarray) -> Iterator[tuple[View, np.ndarray, np.ndarray]]:
        """Each view, its residual, and the derivative of that by each number along a fourth axis.

        The residual has the shape (height, width, 3).
        """
        key = x.tobytes()
        if key not in self._slopes:
            self._slopes.clear()
            found = self._residuals_and_slopes(x)
            if self.count * sum(view.target.size for view in self.views) > KEPT:
                yield from ((view, *own) for view, own in zip(self.views, found, strict=True))
                return
            self._slopes[key] = list(found)
        yield from ((view, *own) for view, own in zip(self.views, self._slopes[key], strict=True))

    def _residuals_and_slopes(self, x: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        directions = [self.parameters(unit) for unit in np.eye(self.count)]
        for view, linearised in zip(self.views, self._at(x), strict=True):
            image = linearised.image.numpy().astype(np.float64)
            tangents = [arrays(view.scene, direction) for direction in directions]
            columns = [c.numpy().astype(np.float64) for c in linearised.along(tangents)]
            residual, gain = self._residual(view, image)
            columns = [self._with_gain(view, image, column, gain) for column in columns]
            yield residual, np.stack(columns, -1)

    def _with_gain(
        self, view: View, image: np.ndarray, column: np.ndarray, gain: np.ndarray
    ) -> np.ndarray:
        """The derivative of gain * image; the gain changes with the image."""
        if not self.gain:
            return column
        power = (view.weight * image * image).sum((0, 1))
        change = (view.weight * column * (view.target - 2 * gain * image)).sum((0, 1))
        return gain * column + image * np.divide(change, power, out=np.zeros(3), where=power > 0)


def label_of(name: str, place: tuple[int, ...]) -> str:
    """The name of a number: of a vector, and of a cloud, its place is told."""
    sphere, axis = (place[:1], place[1:]) if name.startswith("clouds.") else ((), place)
    return ".".join([name, *map(str, sphere), *("xyz"[k] for k in axis)])


def split(like: Mapping[str, Any], x: np.ndarray) -> dict[str, Any]:
    """The numbers of a vector by name; each name gets as many as its value has."""
    parts = np.split(x, np.cumsum([np.size(value) for value in like.values()])[:-1])
    return {
        name: part.reshape(np.shape(value)).tolist()
        for (name, value), part in zip(like.items(), parts, strict=True)
    }


def numbers_in(values: Iterable[Array]) -> np.ndarray:
    """All numbers of some parameters as one vector, sphere by sphere."""
    return np.concatenate([dr.detach(value).numpy().T.ravel() for value in values]).astype(float)


def arrays(scene: Scene, values: Mapping[str, Any]) -> dict[str, Array]:
    """Parameters as Dr.Jit arrays of a scene's types."""
    own = scene.parameters(*values)
    return {
        name: as_parameter(name, value, own[name], scene.locations[name].entry.many)
        for name, value in values.items()
    }
