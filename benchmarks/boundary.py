"""Accuracy of images with edges, and their cost: python benchmarks/boundary.py [pixels] [cost]
[--scene NAME]

pixels: images with and without edges at some samples a pixel, single precision, against plain
samples in double at 1024 a pixel. cost: times on the yardstick's scene, in turns. Writes
docs/pixels.png when no scene is left out, and else to the folder `out` (needs the `bench` extra).
The errors of derivatives are those of gradients.py.
"""

import argparse
import importlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
SCENES = HERE.parent / "scenes"
PLAIN, BOUNDARY = (1, 4, 16, 64, 256), (1, 4, 16)
SPHERES = [f"spheres.sphere{k}.{field}" for k in range(3) for field in ("center", "radius")]
MATERIALS = ["materials.mirror.ior", "materials.glass.ior", "materials.green.ior"]
NAMES = [
    *SPHERES,
    *MATERIALS,
    "lights.light0.position",
    "lights.light0.intensity",
    "camera.position",
]


def relative(image: np.ndarray, reference: np.ndarray) -> float:
    """The error in the L2 norm; infinite where there should be nothing, NaN where there is nothing
    either.
    """
    error, size = np.linalg.norm(image - reference), np.linalg.norm(reference)
    return error / size if size else (np.inf if error else np.nan)


def slope(spp: tuple[int, ...], errors: list[float]) -> float:
    """The exponent of the samples in the error."""
    return float(np.polyfit(np.log(spp), np.log(errors), 1)[0])


def panels(names: list[str]):
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
    return figure, dict(zip(names, grid.flat, strict=False))


def save(figure, path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=100, pil_kwargs={"optimize": True})
    print(f"wrote {path}", flush=True)


def pixels(names: list[str], folder: Path) -> None:
    """Errors of images."""
    import whitted as wt

    figure, axes = panels(names)
    print("pixels, 256 x 256: relative RMSE", flush=True)
    print(
        f"{'scene':20}{'':10}"
        + "".join(f"{f'spp {n}':>10}" for n in PLAIN)
        + f"{'slope':>8}  boundary at n beats plain at 16 n"
    )
    for name in names:

        def image(
            spp: int,
            boundary: bool,
            precision: str = "single",
            path: Path = SCENES / f"{name}.toml",
        ) -> np.ndarray:
            scene = wt.load_scene(path, precision)
            return (
                wt.render(scene, spp, boundary=boundary, resolution=(256, 256))
                .numpy()
                .astype(np.float64)
            )

        reference = image(1024, False, "double")
        errors = {
            "plain": {n: relative(image(n, False), reference) for n in PLAIN},
            "boundary": {n: relative(image(n, True), reference) for n in BOUNDARY},
        }
        beats = [
            f"{n}: {'yes' if errors['boundary'][n] < errors['plain'][16 * n] else 'NO'}"
            for n in BOUNDARY
        ]
        for kind, marker in (("plain", "o-"), ("boundary", "s-")):
            spp, values = tuple(errors[kind]), list(errors[kind].values())
            steep = slope(spp, values)
            cells = "".join(f"{value:10.5f}" for value in values) + " " * 10 * (
                len(PLAIN) - len(values)
            )
            print(
                f"{name:20}{kind:10}{cells}{steep:8.2f}  {', '.join(beats) if kind == 'boundary' else ''}",
                flush=True,
            )
            axes[name].plot(spp, values, marker, label=f"{kind}, slope {steep:.2f}")
        axes[name].legend()
    axes[names[0]].set_ylabel("relative RMSE")
    save(figure, folder / "pixels.png")


def calls() -> dict:
    """Images and gradients of the yardstick's scene."""
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


def clock(call) -> float:
    """Milliseconds of a call, with all its kernels."""
    import drjit as dr

    dr.sync_thread()
    start = time.perf_counter()
    dr.eval(call())
    dr.sync_thread()
    return (time.perf_counter() - start) * 1e3


def cold() -> None:
    """Seconds to compile each call, in this order, in a new process."""
    from whitted import timing

    for name, call in calls().items():
        with timing.recorded() as kernels:
            clock(call)
        print(
            f"{name:30}{kernels.compile_seconds:8.2f} s to compile {kernels.compiled} kernels",
            flush=True,
        )


def kernels(call) -> None:
    """What a call's kernels took."""
    import drjit as dr

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        clock(call)
        history = [entry for entry in dr.kernel_history() if entry["type"] == dr.KernelType.JIT]
    print(f"{sum(entry['execution_time'] for entry in history):.1f} ms in {len(history)} kernels")
    for entry in sorted(history, key=lambda entry: -entry["execution_time"])[:10]:
        print(
            f"    {entry['execution_time']:8.2f} ms, {entry['size']:>8} lanes, {entry['operation_count']:>6} operations"
        )


def crossings(call) -> int:
    """How many crossings a gradient loop finds."""
    module, found = importlib.import_module("whitted.render"), []
    correct = module.correct

    def counted(band, keep):
        pixels, edges = correct(band, keep)
        found.append(sum(len(crossings) for _, crossings, _ in edges.crossed))
        return pixels, edges

    module.correct = counted
    try:
        clock(call)
    finally:
        module.correct = correct
    return sum(found)


def cost(rounds: int = 25) -> None:
    """Times with edges and without, taking turns; compile times are of an empty cache."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "DRJIT_CACHE_DIR": cache}
        subprocess.run([sys.executable, __file__, "cold"], env=environment, check=True)
    turns = calls()
    times: dict[str, list[float]] = {name: [] for name in turns}
    for _ in range(rounds):
        for name, call in turns.items():
            times[name].append(clock(call))
    middle = {name: statistics.median(values[5:]) for name, values in times.items()}
    bounds = {"image with boundary": 2.5, "gradient loop with boundary": 6}
    for name, value in middle.items():
        ratio = f"{value / middle['plain image']:6.2f} x plain image"
        allowed = f", allowed {bounds[name]}" if name in bounds else ""
        print(
            f"{name:30}{value:8.2f} ms (fastest {min(times[name]):.2f}) {ratio}{allowed}",
            flush=True,
        )
    print(f"{crossings(turns['gradient loop with boundary'])} crossings found")
    for name in bounds:
        print(f"{name}: ", end="")
        kernels(turns[name])


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", help="pixels, cost; both if none")
    parser.add_argument(
        "--scene", action="append", help="only this scene of the folder scenes; may be repeated"
    )
    arguments = parser.parse_args()
    parts = arguments.parts or ["pixels", "cost"]
    names = arguments.scene or sorted(path.stem for path in SCENES.glob("*.toml"))
    whole = len(names) == len(list(SCENES.glob("*.toml")))
    folder = HERE.parent / "docs" if whole else Path("out")
    if "pixels" in parts:
        pixels(names, folder)
    if "cost" in parts:
        cost()
    if "cold" in parts:
        cold()


if __name__ == "__main__":
    main()
