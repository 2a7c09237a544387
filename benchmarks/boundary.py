"""Measure the errors and the cost of images with edges.

    python benchmarks/boundary.py [pixels] [cost] [--scene NAME]

pixels: errors of images with and without edges, in single precision, at several numbers of samples
a pixel. The reference is plain samples in double precision, 16384 a pixel. The plot is written to
results/pixels.png if all scenes are measured, else to out/pixels.png (needs the `bench` extra).

cost: times with and without edges on the yardstick's scene, in turns.

The errors of derivatives are measured by gradients.py.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np
from clock import milliseconds

HERE = Path(__file__).parent
SCENES = HERE.parent / "scenes"
# Samples a pixel of images without and with edges, and of the reference. Each of those with edges
# is compared with 16 times as many plain ones.
PLAIN, BOUNDARY, REFERENCE = (1, 4, 16, 64, 256), (1, 4, 16), 16384
SPHERES = [f"spheres.sphere{k}.{field}" for k in range(3) for field in ("center", "radius")]
MATERIALS = ["materials.mirror.ior", "materials.glass.ior", "materials.green.ior"]
# The parameters of the gradients whose cost is measured
NAMES = [
    *SPHERES,
    *MATERIALS,
    "lights.light0.position",
    "lights.light0.intensity",
    "camera.position",
]
# How many times the time of a plain image these calls may take
ALLOWED = {"image with boundary": 2.5, "gradient loop with boundary": 6}


def relative(image: np.ndarray, reference: np.ndarray) -> float:
    """The error in the L2 norm, relative to the reference.

    Of a reference of zeros, the error of another image is infinite, and that of zeros NaN.
    """
    error, size = np.linalg.norm(image - reference), np.linalg.norm(reference)
    return error / size if size else (np.inf if error else np.nan)


def slope(spp: tuple[int, ...], errors: list[float]) -> float:
    """The power of the number of samples with which the error grows; it falls where negative."""
    return float(np.polyfit(np.log(spp), np.log(errors), 1)[0])


def panels(names: list[str]):
    """A figure with a panel for each name: samples to the right, errors upwards, both as logs."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = -(-len(names) // 3)
    figure, grid = plt.subplots(
        rows,
        min(3, len(names)),
        figsize=(14, 4 * rows),
        constrained_layout=True,
        sharex=True,
        sharey=True,
        squeeze=False,
    )
    for panel, name in zip(grid.flat, names, strict=False):
        panel.set(title=name, xscale="log", yscale="log")
        panel.grid(alpha=0.3)
    for panel in grid[-1]:
        panel.set_xlabel("samples a pixel")
    for panel in grid.flat[len(names) :]:
        panel.set_axis_off()
    return figure, dict(zip(names, grid.flat, strict=False))


def save(figure, path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=100, pil_kwargs={"optimize": True})
    print(f"wrote {path}", flush=True)


def image_of(scene, spp: int, boundary: bool) -> np.ndarray:
    import whitted as wt

    image = wt.render(scene, spp, boundary=boundary, resolution=(256, 256))
    return image.numpy().astype(np.float64)


def pixels(names: list[str], folder: Path) -> None:
    """Measure, print and plot the errors of images."""
    import whitted as wt

    figure, axes = panels(names)
    print("pixels, 256 x 256: relative RMSE", flush=True)
    columns = "".join(f"{f'spp {n}':>10}" for n in PLAIN)
    print(f"{'scene':20}{'':10}{columns}{'slope':>8}  boundary at n beats plain at 16 n")
    for name in names:
        scene, double = (
            wt.load_scene(SCENES / f"{name}.toml", precision) for precision in ("single", "double")
        )
        reference = image_of(double, REFERENCE, False)
        errors = {
            "plain": {n: relative(image_of(scene, n, False), reference) for n in PLAIN},
            "boundary": {n: relative(image_of(scene, n, True), reference) for n in BOUNDARY},
        }
        verdicts = ", ".join(
            f"{n}: {'yes' if errors['boundary'][n] < errors['plain'][16 * n] else 'NO'}"
            for n in BOUNDARY
        )
        for kind, marker in (("plain", "o-"), ("boundary", "s-")):
            spp, values = tuple(errors[kind]), list(errors[kind].values())
            steep = slope(spp, values)
            cells = "".join(f"{value:10.5f}" for value in values).ljust(10 * len(PLAIN))
            end = verdicts if kind == "boundary" else ""
            print(f"{name:20}{kind:10}{cells}{steep:8.2f}  {end}", flush=True)
            axes[name].plot(spp, values, marker, label=f"{kind}, slope {steep:.2f}")
        axes[name].legend()
    axes[names[0]].set_ylabel("relative RMSE")
    save(figure, folder / "pixels.png")


def calls() -> dict[str, Callable]:
    """Images and gradients of the yardstick's scene, each with other parameters than the last."""
    import drjit as dr

    import whitted as wt

    scene = wt.load_scene(HERE / "yardstick.toml")

    def changed() -> dict:
        ours = scene.parameters(*NAMES)
        ours["spheres.sphere0.center"] = ours["spheres.sphere0.center"] + 1e-6
        dr.eval(ours)
        return ours

    def image(boundary: bool):
        return wt.render(scene.replace(changed()), boundary=boundary)

    def loop(boundary: bool):
        ours = changed()
        dr.enable_grad(ours)
        dr.backward(
            dr.mean(dr.square(wt.render(scene.replace(ours), boundary=boundary) - 0.5), axis=None)
        )
        return dr.grad(ours)

    return {
        "plain image": lambda: image(False),
        "image with boundary": lambda: image(True),
        "plain gradient loop": lambda: loop(False),
        "gradient loop with boundary": lambda: loop(True),
    }


def cold() -> None:
    """Print the seconds that each call compiles, one after the other in this process."""
    from whitted.measure.timing import recorded

    for name, call in calls().items():
        with recorded() as kernels:
            milliseconds(call)
        seconds = f"{kernels.compile_seconds:8.2f} s to compile {kernels.compiled} kernels"
        print(f"{name:30}{seconds}", flush=True)


def print_kernels(call: Callable) -> None:
    """Print how long a call's kernels took: all of them, and each of the ten slowest."""
    import drjit as dr

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        milliseconds(call)
        history = [entry for entry in dr.kernel_history() if entry["type"] == dr.KernelType.JIT]
    print(f"{sum(entry['execution_time'] for entry in history):.1f} ms in {len(history)} kernels")
    for entry in sorted(history, key=lambda entry: -entry["execution_time"])[:10]:
        size = f"{entry['size']:>8} lanes, {entry['operation_count']:>6} operations"
        print(f"    {entry['execution_time']:8.2f} ms, {size}")


def crossings(call: Callable) -> int:
    """How many crossings of edges a gradient loop finds."""
    from whitted.rendering import job

    found = []

    def counted(*given):
        pixels, parts = correct(*given)
        found.append(sum(len(chunk.crossings) for edges in parts for chunk in edges.crossed))
        return pixels, parts

    correct = job.correct
    with patch.object(job, "correct", counted):
        milliseconds(call)
    return sum(found)


def cost(rounds: int = 25) -> None:
    """Print compile times, of a new process with an empty cache, and times of calls in turns."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "DRJIT_CACHE_DIR": cache}
        subprocess.run([sys.executable, __file__, "cold"], env=environment, check=True)
    turns = calls()
    times: dict[str, list[float]] = {name: [] for name in turns}
    for _ in range(rounds):
        for name, call in turns.items():
            times[name].append(milliseconds(call))
    # The first calls compile and warm up
    median = {name: statistics.median(values[5:]) for name, values in times.items()}
    for name, value in median.items():
        ratio = f"{value / median['plain image']:6.2f} x plain image"
        allowed = f", allowed {ALLOWED[name]}" if name in ALLOWED else ""
        fastest = f"fastest {min(times[name]):.2f}"
        print(f"{name:30}{value:8.2f} ms ({fastest}) {ratio}{allowed}", flush=True)
    print(f"{crossings(turns['gradient loop with boundary'])} crossings found")
    for name in ALLOWED:
        print(f"{name}: ", end="")
        print_kernels(turns[name])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", help="pixels, cost [default: both]")
    parser.add_argument(
        "--scene",
        action="append",
        metavar="NAME",
        help="measure only this scene of the folder scenes; may be repeated",
    )
    arguments = parser.parse_args()
    parts = arguments.parts or ["pixels", "cost"]
    names = arguments.scene or sorted(path.stem for path in SCENES.glob("*.toml"))
    whole = len(names) == len(list(SCENES.glob("*.toml")))
    folder = HERE.parent / "results" if whole else Path("out")
    if "pixels" in parts:
        pixels(names, folder)
    if "cost" in parts:
        cost()
    # Not for users: `cost` runs it in a process of its own
    if "cold" in parts:
        cold()


if __name__ == "__main__":
    main()
