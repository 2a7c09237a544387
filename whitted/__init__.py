"""A differentiable Whitted ray tracer on Dr.Jit's LLVM backend."""

import signal
import sys
from pathlib import Path

from .llvm import BackendError, configure

__version__ = "0.2.0"
__all__ = [
    "BackendError",
    "Camera",
    "Checkerboard",
    "Cloud",
    "DirectionalLight",
    "Disc",
    "FitResult",
    "Material",
    "Pick",
    "Plane",
    "PointLight",
    "Scene",
    "SceneError",
    "Sphere",
    "__version__",
    "fit",
    "from_mitsuba",
    "gradient",
    "load_scene",
    "parse_scene",
    "pick",
    "read_image",
    "render",
    "show",
    "to_srgb",
    "torch_render",
    "view",
    "write_image",
]

if (
    Path(sys.argv[0]).name == "whitted"
    and signal.getsignal(signal.SIGINT) is signal.default_int_handler
):
    # While the command line starts, Ctrl-C ends it without a word; then `cli.main` catches it
    signal.signal(signal.SIGINT, signal.SIG_DFL)

try:
    configure()
except BackendError:

    def __getattr__(name: str) -> object:
        """Without LLVM every name raises `BackendError` when it is asked for: the command line can
        start and print it.
        """
        if not name.startswith("__"):
            configure()
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
else:
    from .files.display import show, to_srgb
    from .files.images import read_image, write_image
    from .inverse.fit import fit
    from .inverse.result import FitResult
    from .rendering.api import render
    from .rendering.gradient import gradient
    from .rendering.notebook import show_in_notebooks
    from .rendering.pick import Pick, pick
    from .scene.files import load_scene, parse_scene
    from .scene.interchange import from_mitsuba
    from .scene.scene import Scene
    from .scene.schema import SceneError
    from .scene.things import (
        Camera,
        Checkerboard,
        Cloud,
        DirectionalLight,
        Disc,
        Material,
        Plane,
        PointLight,
        Sphere,
    )
    from .torch import torch_render
    from .view.notebook import view

    show_in_notebooks()
