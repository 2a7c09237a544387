"""Images on the screen: in a notebook, or in the system's viewer of pictures."""

import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
from drjit.llvm import ad

from . import png
from .images import rgb
from .viewer import view


def to_srgb(image: object) -> np.ndarray:
    """Encode an image for screens.

    Args:
        image: linear RGB of shape (height, width, 3), a Dr.Jit tensor or anything that NumPy
            converts to an array.

    Returns:
        sRGB (IEC 61966-2-1) of radiance clipped to [0, 1], uint8 of the same shape.

    Raises:
        ValueError: another shape.
    """
    return png.in_8_bits(rgb(Path("image"), image))


def show(image: object) -> None:
    """Show an image or a scene: below the cell of a notebook, else in the system's viewer.

    Where there is no viewer of pictures, a PNG is written to the folder for temporary files, and a
    line says where.

    Args:
        image: linear RGB of shape (height, width, 3), a Dr.Jit tensor or anything that NumPy
            converts to an array; or a `Scene`, which is shown as a small picture of plain samples.

    Raises:
        ValueError: another shape.
    """
    import tempfile

    # A scene makes its picture itself
    data = image._repr_png_() if hasattr(image, "_repr_png_") else png_of(image)
    if notebook() is not None:
        from IPython.display import Image as Picture
        from IPython.display import display

        display(Picture(data=data, format="png"))
        return
    path = Path(tempfile.mkdtemp(prefix="whitted-")) / "image.png"
    path.write_bytes(data)
    if not view(path):
        print(f"there is no program that shows pictures; wrote {path}")


def png_of(image: object) -> bytes:
    """An image as the bytes of a PNG file."""
    from PIL import Image

    memory = io.BytesIO()
    Image.fromarray(to_srgb(image)).save(memory, format="png")
    return memory.getvalue()


def notebook() -> Any:
    """The IPython of the notebook that this runs in; None elsewhere, a terminal's IPython too."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell if shell is not None and hasattr(shell, "kernel") else None


def show_tensors_in_notebooks() -> None:
    """Let a notebook show a cell's value as a picture, if it is a tensor with the shape of one."""
    shell = notebook()
    if shell is not None:
        formatter = shell.display_formatter.formatters["image/png"]
        for kind in (ad.TensorXf, ad.TensorXf64):
            formatter.for_type(kind, _png_or_none)


def _png_or_none(tensor: Any) -> bytes | None:
    if tensor.ndim != 3 or tensor.shape[2] != 3 or 0 in tensor.shape:
        return None
    return png_of(tensor)
