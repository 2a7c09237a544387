"""The way between NumPy's arrays and those of kernels.

Kernels are compiled for arrays of a certain alignment and of more than one lane. So what NumPy
hands over is copied into Dr.Jit's own memory, and filled up to whole packets.
"""

from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm import ad

from .arrays import Array, Precision, precision_of

# Lanes of a packet, as many as the widest vector instructions have. Fewer would leave some idle.
PACKET = 16
# Dr.Jit's type for each of NumPy's
TYPES = {
    np.dtype(dtype): kind
    for dtype, kind in (
        (bool, ad.Bool),
        ("f4", ad.Float),
        ("f8", ad.Float64),
        ("u4", ad.UInt),
        ("u8", ad.UInt64),
    )
}


def to_lanes(array: np.ndarray) -> Array:
    """A Dr.Jit array of whole packets; zeros fill the last one up."""
    return to_array(array, -(-len(array) // PACKET) * PACKET)


def to_array(array: np.ndarray, length: int) -> Array:
    """A Dr.Jit array of some length in Dr.Jit's own memory, with zeros behind what is given.

    An array in NumPy's memory, of another alignment, would get a kernel of its own.
    """
    result: Array = dr.empty(TYPES[array.dtype], length)
    memory = result.numpy()
    memory[: len(array)], memory[len(array) :] = array, 0
    return result


def to_numpy(value: Any) -> Any:
    """Dr.Jit's arrays, also those in dataclasses, as NumPy's. Waits for the kernels that make them.

    A vector becomes a tuple of its components.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return type(value)(**{name: to_numpy(part) for name, part in vars(value).items()})
    if dr.depth_v(value) == 1:
        return value.numpy()
    return tuple(component.numpy() for component in value)


def to_numbers(value: Array) -> list[Any] | np.ndarray:
    """The numbers of an array: a list, or NumPy's array if it is wide; of a vector, three."""
    if dr.depth_v(value) == 1:
        value = dr.detach(value)
        return list(value) if dr.width(value) == 1 else value.numpy().copy()
    return [to_numbers(part) for part in value]


def from_numbers(numbers: list[Any] | np.ndarray, precision: Precision) -> Array:
    """The reverse of `to_numbers`: an array in Dr.Jit's own memory."""
    if len(numbers) and isinstance(numbers[0], (list, np.ndarray)):
        return precision.vector(*(from_numbers(own, precision) for own in numbers))
    if len(numbers) == 1:
        return dr.opaque(precision.real, numbers[0])
    return to_array(np.asarray(numbers, precision.dtype), len(numbers))


def in_own_memory(value: Array) -> Array:
    """A copy of an array in Dr.Jit's own memory, attached to the same gradients."""
    own = from_numbers(to_numbers(value), precision_of(value))
    return dr.replace_grad(own, value) if dr.grad_enabled(value) else own


def opaque_copy(value: Array) -> Array:
    """An array in Dr.Jit's own memory, without its numbers being read.

    What kernels still have to compute comes there anyhow.
    """
    if value.state not in (dr.VarState.Literal, dr.VarState.Unevaluated):
        value = value + dr.opaque(precision_of(value).real, 0)
    dr.make_opaque(value)
    return value


def stacked(components: Sequence[np.ndarray], which: slice | np.ndarray) -> np.ndarray:
    """Some elements of a vector, shape (components, elements)."""
    return np.stack([component[which] for component in components])


def chunks(n: int, size: int) -> Iterator[slice]:
    """Slices of at most so many elements that cover n."""
    for first in range(0, n, size):
        yield slice(first, min(first + size, n))
