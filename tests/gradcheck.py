"""A gradient checker: forward mode against central differences, and reverse mode against forward
mode.

Central differences are taken in float64. They see jumps, which derivatives of samples leave out, so
that a number of the image counts only where the differences to both sides agree: no edge has
crossed its sample in between.
"""

from dataclasses import dataclass

import drjit as dr
import numpy as np

from whitted.core.host import to_array

# How far two sums of the same products may be apart, relative to the sum of their moduli: each has
# some 4000 terms, and is off by no more roundings than that
SUM = 4096 * 2.0**-52


@dataclass(frozen=True)
class Comparison:
    """Forward mode against differences, in one direction of parameter space."""

    forward: np.ndarray
    differences: np.ndarray
    smooth: np.ndarray  # bool: no edge crossed the sample

    @property
    def error(self):
        """The largest error where the image is smooth, relative to the largest derivative there."""
        scale = abs(self.differences[self.smooth]).max(initial=0) or 1.0
        return abs(self.forward - self.differences)[self.smooth].max(initial=0) / scale


def directions(values, seed=0):
    """A random tangent for each parameter: name to array of the parameter's shape."""
    rng = np.random.default_rng(seed)
    return {
        name: rng.uniform(0.5, 1, np.shape(value.numpy())) * rng.choice([-1, 1])
        for name, value in values.items()
    }


def as_type(array, numbers):
    """Numbers as a Dr.Jit array like another."""
    return type(array)(*np.ravel(numbers).tolist())


def like(image, numbers):
    """Numbers as a tensor like an image, in Dr.Jit's own memory."""
    flat = np.ravel(numbers).astype("f4" if dr.type_v(image) is dr.VarType.Float32 else "f8")
    return type(image)(to_array(flat, flat.size), image.shape)


def jvp(function, values, tangents):
    """The derivative of an image along the tangents, forward."""
    inputs = {name: type(value)(value) for name, value in values.items()}
    dr.enable_grad(inputs)
    for name, value in inputs.items():
        dr.set_grad(value, as_type(value, tangents[name]))
    return dr.forward_to(function(inputs)).numpy()


def vjp(function, values, weights):
    """The derivatives of the weighted sum of an image's numbers, in reverse: name to array."""
    inputs = {name: type(value)(value) for name, value in values.items()}
    dr.enable_grad(inputs)
    image = function(inputs)
    dr.backward(dr.sum((image * like(image, weights)).array))
    return {name: np.ravel(dr.grad(value).numpy()) for name, value in inputs.items()}


def compare(function, values, tangents, step=1e-5):
    """Forward mode against central differences of fourth order, in double precision.

    Args:
        function: a dictionary of Dr.Jit arrays to an image.
        values: where to differentiate.
        tangents: name to array, the direction to differentiate in.
        step: truncation is about step^4, and rounding 1e-16 / step.
    """

    def at(t):
        moved = {
            name: as_type(value, np.ravel(value.numpy()) + t * np.ravel(tangents[name]))
            for name, value in values.items()
        }
        return function(moved).numpy()

    center, right, left, far_right, far_left = (at(k * step) for k in (0, 1, -1, 2, -2))
    differences = (8 * (right - left) - (far_right - far_left)) / (12 * step)
    # A jump bends the image by its height over the step, 1e4 and more, and a kink by its change of
    # slope; curvature does so by its product with the step, some 1e-5
    bend = (
        abs(np.stack([right - 2 * center + left, far_right - 2 * center + far_left])).max(0) / step
    )
    smooth = bend <= 1e-2 * (abs(differences) + 1)
    return Comparison(jvp(function, values, tangents), differences, smooth)


def adjoint_error(function, values, tangents, seed=0):
    """How far <w, J v> and <J' w, v> are apart, relative to the sum of the moduli of the first's
    terms: no more than `SUM`, where both modes differentiate the same function.
    """
    forward = jvp(function, values, tangents)
    weights = np.random.default_rng(seed).uniform(-1, 1, forward.shape)
    gradients = vjp(function, values, weights)
    there = np.sum(weights * forward)
    back = sum(np.sum(gradients[name] * np.ravel(tangents[name])) for name in values)
    return abs(there - back) / (np.sum(abs(weights * forward)) or 1.0)


def image_difference(function, values, tangents, step=2e-5):
    """Central differences of a whole image, edges and all, and their own error: how far those of
    twice the step are away.

    Returns:
        The differences, and the error relative to their norm.
    """

    def slope(h):
        right, left = (
            function(
                {
                    name: as_type(v, np.ravel(v.numpy()) + t * np.ravel(tangents[name]))
                    for name, v in values.items()
                }
            )
            for t in (h, -h)
        )
        return (right.numpy() - left.numpy()) / (2 * h)

    near, far = slope(step), slope(2 * step)
    return near, image_error(far, near)


def image_error(image, reference):
    """The distance of two images, relative to the norm of the second."""
    return np.linalg.norm(image - reference) / np.linalg.norm(reference)
