"""The files that a fit writes: the recovered scene, pictures, a plot and an animation."""

from pathlib import Path
from typing import Any

import numpy as np

from ..files.atomic import atomically
from ..files.false_color import write_diverging
from ..files.images import as_numpy, write_image
from ..files.png import to_srgb
from ..files.writable import check_folder
from ..rendering.samples import render_samples
from ..scene.scene import Scene
from .result import FitResult

NAMES = (
    *("scene.toml", "target.png", "start.png", "result.png"),
    *("difference.png", "convergence.png", "animation.gif"),
)
# Frames and width of the animation, at most; how long each frame is shown, and the last one
FRAMES, WIDTH, MILLISECONDS, AT_END = 50, 256, 120, 2000


def write_recovery(
    folder: Path,
    start: Scene,
    target: Any,
    result: FitResult,
    options: dict[str, Any],
) -> list[Path]:
    """Write all files of a fit to a folder, which is created if it is missing.

    Args:
        target: the image that was fitted.
        options: of `render`.

    Returns:
        The files: scene.toml, target.png, start.png, result.png, difference.png (result less
        target), convergence.png and animation.gif (the fit on the left, the target on the right).

    Raises:
        RuntimeError: there is no matplotlib.
        ValueError: the folder, or one of the files in it, cannot be written to.
        OSError: a file cannot be written.
    """
    check_folder(folder, NAMES)
    folder.mkdir(exist_ok=True)
    pixels = as_numpy(target)
    options = {**options, "resolution": (pixels.shape[1], pixels.shape[0])}
    found = render_samples(result.scene, **options).numpy()
    result.scene.save(folder / "scene.toml")
    write_image(folder / "target.png", pixels)
    write_image(folder / "start.png", render_samples(start, **options))
    write_image(folder / "result.png", found)
    write_diverging(folder / "difference.png", found - pixels, "result - target")
    atomically(folder / "convergence.png", lambda path: result.plot(str(path)))
    frames = _frames(start, pixels, result, options)
    atomically(folder / "animation.gif", lambda path: _animate(path, frames))
    return [folder / name for name in NAMES]


def _frames(
    start: Scene, target: np.ndarray, result: FitResult, options: dict[str, Any]
) -> list[np.ndarray]:
    """Iterations as 8-bit pictures, with the target beside them."""
    every = -(-target.shape[1] // WIDTH)
    small = _shrunk(target, every)
    chosen = np.unique(np.linspace(0, len(result.history) - 1, FRAMES).astype(int))
    frames = []
    for k in chosen:
        values = result.named(result.history[k].x)
        image = _shrunk(render_samples(start.replace(values), **options).numpy(), every)
        frames.append(np.hstack([image, small]))
    return frames


def _animate(path: Path, frames: list[np.ndarray]) -> None:
    from PIL import Image

    first, *rest = [Image.fromarray(frame) for frame in frames]
    duration = [MILLISECONDS] * len(rest) + [AT_END]
    first.save(path, save_all=True, append_images=rest, duration=duration, loop=0)


def _shrunk(image: np.ndarray, every: int) -> np.ndarray:
    """A smaller picture as 8-bit sRGB; each pixel is the mean of `every` x `every` pixels."""
    rows, columns = image.shape[0] // every, image.shape[1] // every
    blocks = image[: rows * every, : columns * every].reshape(rows, every, columns, every, 3)
    means = blocks.mean((1, 3))
    return (to_srgb(means) * 255 + 0.5).astype(np.uint8)
