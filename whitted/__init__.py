"""A differentiable Whitted ray tracer on Dr.Jit's LLVM backend."""

import signal
import sys
from pathlib import Path

from .llvm import BackendError, configure

__version__ = "0.1.0"
__all__ = [
    "BackendError",
    "FitResult",
    "Scene",
    "SceneError",
    "__version__",
    "fit",
    "gradient",
    "load_scene",
    "read_image",
    "render",
    "torch_render",
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
    from .files.images import read_image, write_image
    from .inverse.fit import FitResult, fit
    from .rendering.api import render
    from .rendering.gradient import gradient
    from .scene.files import SceneError, load_scene
    from .scene.scene import Scene
    from .torch import torch_render
