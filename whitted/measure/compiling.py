"""Compile times, in processes that find no kernel in a cache."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import drjit as dr

from ..rendering.samples import render_samples
from ..scene.files import load_scene
from .timing import recorded


def compile_seconds(path: Path, levels: int) -> float:
    """Seconds to compile the kernel of plain samples.

    Args:
        path: the scene file.
        levels: of the tree of rays that are straight code, as of `render(unroll=)`.
    """
    command = [sys.executable, "-m", __name__, str(path), str(levels)]
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "DRJIT_CACHE_DIR": cache}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return float(done.stdout)


def _print_compile_seconds(path: str, levels: str) -> None:
    scene = load_scene(path)
    with recorded() as kernels:
        dr.eval(render_samples(scene, boundary=False, resolution=(16, 16), unroll=int(levels)))
    print(kernels.compile_seconds)


if __name__ == "__main__":
    _print_compile_seconds(*sys.argv[1:])
