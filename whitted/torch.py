"""Images for PyTorch, with gradients through both frameworks (needs the extra `torch`)."""

from collections.abc import Mapping
from typing import Any

import drjit as dr

from .core.arrays import Array
from .rendering.api import render
from .scene.scene import Scene


def torch_render(scene: Scene, parameters: Mapping[str, Any], spp: int = 1, **options: Any) -> Any:
    """Render a scene with parameters from PyTorch, differentiably in them.

    Args:
        parameters: name, as in `Scene.parameters`, to a tensor on the CPU: of one number, or of
            three for a vector; float32 for a scene in single precision, float64 in double.
        spp, options: of `render`.

    Returns:
        Linear RGB radiance, a tensor of shape (height, width, 3).

    Raises:
        KeyError: a name that the scene does not have.
        ValueError: a tensor of another size or type, or what `render` refuses.
        RuntimeError: there is no PyTorch.
    """
    try:
        import torch
    except ImportError:
        raise RuntimeError(
            "torch_render needs PyTorch, which is missing; "
            "install it with: pip install 'whitted[torch]'"
        ) from None
    own = scene.parameters(*parameters) if parameters else {}
    kind = getattr(torch, scene.precision.dtype.__name__)
    for name, value in parameters.items():
        size = 3 if dr.depth_v(own[name]) == 2 else 1
        if not isinstance(value, torch.Tensor) or value.numel() != size or value.dtype != kind:
            got = _described(value)
            raise ValueError(f"{name}: expected a tensor of {size} x {kind}, got {got}")

    @dr.wrap(source="torch", target="drjit")
    def image(*tensors: Array) -> Array:
        given = zip(own.items(), tensors, strict=True)
        values = {name: _parameter(type(old), tensor.array) for (name, old), tensor in given}
        return render(scene.replace(values), spp, **options)

    return image(*(value.reshape(-1) for value in parameters.values()))


def _parameter(kind: Any, numbers: Array) -> Array:
    """A parameter's array, made of a flat array of its numbers."""
    if dr.depth_v(kind) == 1:
        return numbers
    return kind(*(dr.gather(type(numbers), numbers, k) for k in range(3)))


def _described(value: object) -> str:
    if hasattr(value, "numel") and hasattr(value, "dtype"):
        return f"{value.numel()} x {value.dtype}"
    return repr(value)
