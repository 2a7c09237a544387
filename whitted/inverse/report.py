"""The files that tell of a fit: the recovered scene, pictures, how it converged, and an animation
of it.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ..files.atomic import atomically, write_text
from ..files.false_color import write_diverging
from ..files.images import as_numpy, write_image
from ..files.png import to_srgb
from ..rendering.samples import render_samples
from ..scene.rewrite import rewritten
from ..scene.scene import Scene
from .convergence import plot
from .fit import FitResult

# The animation's frames at most, its width at most, and how long it shows each
FRAMES, WIDTH, MILLISECONDS = 50, 256, 120


def write_recovery(
    folder: Path,
    scene_file: Path,
    start: Scene,
    target: Any,
    result: FitResult,
    options: dict[str, Any],
) -> list[Path]:
    """Write all files of a fit to a folder, which is made if it is not there.

    Args:
        scene_file: the file that `start` was read from.
        target: the image that was fitted.
        options: of `render`.

    Returns:
        The files: scene.toml, target.png, start.png, result.png, difference.png (result less
        target), convergence.png and animation.gif (the fit on the left, the target on the right).

    Raises:
        RuntimeError: there is no matplotlib, or no tomlkit.
        OSError: a file cannot be written.
    """
    text = rewritten(scene_file, result.parameters)
    folder.mkdir(exist_ok=True)
    pixels = as_numpy(target)
    options = {**options, "resolution": (pixels.shape[1], pixels.shape[0])}
    found = render_samples(result.scene, **options).numpy()
    write_text(folder / "scene.toml", text)
    write_image(folder / "target.png", pixels)
    write_image(folder / "start.png", render_samples(start, **options))
    write_image(folder / "result.png", found)
    write_diverging(folder / "difference.png", found - pixels, "result - target")
    atomically(
        folder / "convergence.png", lambda path: plot(result.history, result.labels, str(path))
    )
    atomically(
        folder / "animation.gif", lambda path: _animate(path, start, pixels, result, options)
    )
    names = (
        "scene.toml",
        "target.png",
        "start.png",
        "result.png",
        "difference.png",
        "convergence.png",
        "animation.gif",
    )
    return [folder / name for name in names]


def _animate(
    path: Path, start: Scene, target: np.ndarray, result: FitResult, options: dict[str, Any]
) -> None:
    """The iterations, and the target beside them."""
    from PIL import Image

    every = -(-target.shape[1] // WIDTH)
    small = _shrunk(target, every)
    chosen = np.unique(np.linspace(0, len(result.history) - 1, FRAMES).astype(int))
    frames = []
    for k in chosen:
        values = result.named(result.history[k].x)
        image = _shrunk(render_samples(start.replace(values), **options).numpy(), every)
        frames.append(Image.fromarray(np.hstack([image, small])))
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=[MILLISECONDS] * (len(frames) - 1) + [2000],
        loop=0,
    )


def _shrunk(image: np.ndarray, every: int) -> np.ndarray:
    """The means of squares of pixels, as 8-bit sRGB."""
    height, width = (n // every * every for n in image.shape[:2])
    means = (
        image[:height, :width]
        .reshape(height // every, every, width // every, every, 3)
        .mean((1, 3))
    )
    return (to_srgb(means) * 255 + 0.5).astype(np.uint8)
