"""How time and memory grow: with pixels, spheres, lights and differentiated parameters."""

import re
import resource
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import drjit as dr

from ..inverse.bounds import start_of
from ..rendering.gradient import gradient
from ..rendering.samples import render_samples
from ..scene.features import reflects
from ..scene.files import load_scene
from ..scene.scene import Scene
from .compiling import compile_seconds
from .enlarged import more_lights, more_spheres
from .setup import Setup
from .store import Rows

# Numbers of spheres or lights that are added to a scene
COUNTS = (1, 2, 4, 8, 16)
METHODS = (("plain", False), ("boundary", True))


def pixels(setup: Setup) -> Rows:
    """Time against the number of pixels, of plain samples and with edges."""
    sides = (64, 128, 256, 512) if setup.quick else (64, 128, 256, 512, 1024)
    rows: Rows = []
    for kind, boundary in METHODS:
        calls = {
            f"{kind}, {n} x {n}": partial(
                render_samples, setup.single, boundary=boundary, resolution=(n, n)
            )
            for n in sides
        }
        rows += _times(setup, calls, kind, [n * n for n in sides])
    return rows


def unrolled(setup: Setup) -> Rows:
    """Time and compile time against the levels of the tree of rays that are straight code."""
    scene = setup.single
    deepest = min(scene.max_depth, 3 if setup.quick else 5) if reflects(scene) else 0
    calls = {
        f"unroll {n}": partial(
            render_samples, scene, boundary=False, resolution=(256, 256), unroll=n
        )
        for n in range(deepest + 1)
    }
    rows = _times(setup, calls, "plain", range(deepest + 1))
    # Here other measurements have compiled some of the kernels before
    return [row | {"compile_s": compile_seconds(setup.path, row["x"])} for row in rows]


def spheres(setup: Setup) -> Rows:
    """Time, compile time and kernel operations against the number of spheres added."""
    scene = setup.single
    return _enlarged(
        setup, lambda n: replace(scene, shapes=(*more_spheres(scene, n), *scene.shapes))
    )


def lights(setup: Setup) -> Rows:
    """Time, compile time and kernel operations against the number of lights added."""
    scene = setup.single
    return _enlarged(
        setup, lambda n: replace(scene, lights=(*scene.lights, *more_lights(scene, n)))
    )


def _enlarged(setup: Setup, scene_with: Callable[[int], Scene]) -> Rows:
    counts = COUNTS[:4] if setup.quick else COUNTS
    calls = {
        f"{n} more": partial(render_samples, scene_with(n), boundary=False, resolution=(256, 256))
        for n in counts
    }
    return _times(setup, calls, "plain", counts)


def parameters(setup: Setup) -> Rows:
    """Time of a gradient, in both modes, against the number of parameters."""
    names = sorted(setup.single.features.live)
    counts = sorted({1, 3, 10, len(names)} & set(range(1, len(names) + 1)))
    calls = {f"reverse, {n} parameters": partial(_reverse, setup, names[:n]) for n in counts}
    rows = _times(setup, calls, "reverse mode, all at once", counts)
    # Forward mode takes one pass for each parameter: its time is known from few
    few = [n for n in counts if n <= 3]
    calls = {f"forward, {n} parameters": partial(_forward, setup, names[:n]) for n in few}
    return rows + _times(setup, calls, "forward mode, one by one", few)


def _reverse(setup: Setup, names: list[str]) -> Any:
    """The derivatives of the image's mean square by parameters, in reverse mode."""
    values = dr.detach(setup.single.parameters(*names))
    dr.enable_grad(values)
    image = setup.render(setup.single.replace(values), 1)
    dr.backward(dr.mean(dr.square(image), axis=None))
    return dr.grad(values)


def _forward(setup: Setup, names: list[str]) -> Any:
    """The derivatives of the image by parameters, or by their x components, in forward mode."""
    scene = setup.single
    components = ["x" if len(start_of(scene, name)) > 1 else None for name in names]
    return [
        gradient(scene, name, component, resolution=setup.size)
        for name, component in zip(names, components, strict=True)
    ]


def _times(
    setup: Setup, calls: Mapping[str, Callable[[], Any]], kind: str, xs: Sequence[int]
) -> Rows:
    """Time calls; each row has its kind, and x, the number that the time is plotted against."""
    rows = setup.times(calls)
    for row, x in zip(rows, xs, strict=True):
        del row["value"]
        row |= {"kind": kind, "x": x}
    return rows


def memory(setup: Setup) -> Rows:
    """Peak memory of a process that renders one image, in MiB, against the number of pixels."""
    sides = (256, 1024) if setup.quick else (256, 1024, 2048)
    rows: Rows = []
    for kind, boundary in METHODS:
        for n in sides:
            arguments = [str(setup.path), str(n), str(int(boundary))]
            command = [sys.executable, "-m", __name__, *arguments]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            mib = float(done.stdout)
            rows.append({"name": f"{kind}, {n} x {n}", "kind": kind, "x": n * n, "mib": mib})
    return rows


def _print_peak_memory(path: str, side: str, boundary: str) -> None:
    """Render an image of side x side pixels, and print this process's peak memory in MiB."""
    resolution = int(side), int(side)
    dr.eval(render_samples(load_scene(path), boundary=boundary == "1", resolution=resolution))
    dr.sync_thread()
    print(peak_memory())


def peak_memory() -> float:
    """The most memory that this process has taken, in MiB."""
    status = Path("/proc/self/status")
    if status.exists():
        # On Linux `getrusage` counts what the parent took, too
        return float(re.findall(r"VmHWM:\s*(\d+) kB", status.read_text())[0]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    _print_peak_memory(*sys.argv[1:])
