"""Images for PyTorch, with gradients through both frameworks (needs the extra `torch`)."""

from collections.abc import Callable, Mapping
from typing import Any

import drjit as dr

from .core.arrays import Array
from .rendering.api import render
from .scene.parameters import check_names
from .scene.scene import Scene, checked_scene


def torch_render(
    scene: Scene,
    parameters: Mapping[str, Any],
    spp: int = 1,
    *,
    error: float | None = None,
    boundary: bool | None = None,
    terms: str = "both",
    max_depth: int | None = None,
    resolution: tuple[int, int] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Any:
    """Render a scene with parameters from PyTorch, differentiably in them.

    Args:
        parameters: name, as in `Scene.parameters`, to a tensor on the CPU: of one number, or of
            three for a vector; float32 for a scene in single precision, float64 in double. Of a
            cloud, of shape (N, 3) or (N,).
        spp, error, boundary, terms, max_depth, resolution, progress: as of `render`.

    Returns:
        Linear RGB radiance, a tensor of shape (height, width, 3).

    Raises:
        TypeError: no scene is given, but its name, say.
        KeyError: a name that the scene does not have.
        ValueError: a tensor of another size or type, or what `render` refuses.
        RuntimeError: there is no PyTorch.
    """
    checked_scene(scene)
    try:
        import torch
    except ImportError:
        raise RuntimeError(
            "torch_render needs PyTorch, which is missing; "
            "install it with: pip install 'whitted[torch]'"
        ) from None
    check_names(parameters, scene.locations)
    own = scene.parameters(*parameters) if parameters else {}
    kind = getattr(torch, scene.precision.dtype.__name__)
    for name, value in parameters.items():
        size = (3 if dr.depth_v(own[name]) == 2 else 1) * dr.width(own[name])
        if not isinstance(value, torch.Tensor) or value.numel() != size or value.dtype != kind:
            got = _described(value)
            raise ValueError(f"{name}: expected a tensor of {size} x {kind}, got {got}")

    @dr.wrap(source="torch", target="drjit")
    def image(*tensors: Array) -> Array:
        given = zip(own.items(), tensors, strict=True)
        values = {name: _parameter(type(old), tensor.array) for (name, old), tensor in given}
        return render(
            scene.replace(values),
            spp,
            error=error,
            boundary=boundary,
            terms=terms,
            max_depth=max_depth,
            resolution=resolution,
            progress=progress,
        )

    return image(*(value.reshape(-1) for value in parameters.values()))


def _parameter(kind: Any, numbers: Array) -> Array:
    """A parameter's array, made of a flat array of its numbers."""
    if dr.depth_v(kind) == 1:
        return numbers
    place = 3 * dr.arange(dr.uint32_array_t(numbers), dr.width(numbers) // 3)
    return kind(*(dr.gather(type(numbers), numbers, place + k) for k in range(3)))


def _described(value: object) -> str:
    if hasattr(value, "numel") and hasattr(value, "dtype"):
        return f"{value.numel()} x {value.dtype}"
    return repr(value)
