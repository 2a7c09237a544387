"""What notebooks show: pictures of scenes and of images."""

from ..files.display import png_of, show_tensors_in_notebooks
from ..scene.scene import Scene
from .samples import render_samples

# Pixels along the longer side of the picture
SIDE = 256


def show_in_notebooks() -> None:
    """Let scenes and images show themselves as pictures where a notebook runs this."""
    Scene._repr_png_ = picture
    show_tensors_in_notebooks()


def picture(scene: Scene) -> bytes:
    """A small picture of a scene, of plain samples, as a PNG."""
    width, height = scene.resolution
    factor = min(1.0, SIDE / max(width, height))
    size = max(1, round(width * factor)), max(1, round(height * factor))
    return png_of(render_samples(scene, boundary=False, resolution=size))
