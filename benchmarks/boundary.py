"""Accuracy and cost of boundary=True: python benchmarks/boundary.py [pixels] [gradients] [cost] [--scene NAME]

pixels: images with and without edges at some samples a pixel, single precision, against plain samples in double at 1024
a pixel. gradients: the forward derivative by every parameter at 16 samples a pixel, in double, against central differences
of images with edges at 81, and of plain samples at 32768 points in a pixel where those are not enough. cost: times on the
yardstick's scene, in turns. Writes docs/pixels.png and docs/gradients.png when no scene is left out, and else to the folder
`out` (needs the `bench` extra).
"""

import argparse
import importlib
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
SCENES = HERE.parent / "scenes"
PLAIN, BOUNDARY = (1, 4, 16, 64, 256), (1, 4, 16)
# Samples a pixel of a reference (not 64, which have the same finer grid as 16)
REFERENCE = 81
# Where that is too coarse to tell whether a derivative is right, so many pixels are sampled anew, plainly, at so many points
# and with larger steps
REFINED, POINTS, STEPS = 1500, 1 << 15, (0.25, 1.0, 4.0)
KINDS = ("center", "radius", "normal", "offset", "color", "ior", "lights.", "camera.position", "fov")

SPHERES = [f"spheres.sphere{k}.{field}" for k in range(3) for field in ("center", "radius")]
MATERIALS = ["materials.mirror.ior", "materials.glass.ior", "materials.green.ior"]
NAMES = [*SPHERES, *MATERIALS, "lights.light0.position", "lights.light0.intensity", "camera.position"]


def relative(image: np.ndarray, reference: np.ndarray) -> float:
    """The error in the L2 norm; infinite where there should be nothing, NaN where there is nothing either."""
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
        rows, min(3, len(names)), figsize=(14, 4 * rows), constrained_layout=True, sharex=True, sharey=True, squeeze=False
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
        f"{'scene':20}{'':10}" + "".join(f"{f'spp {n}':>10}" for n in PLAIN) + f"{'slope':>8}  boundary at n beats plain at 16 n"
    )
    for name in names:

        def image(spp: int, boundary: bool, precision: str = "single", path: Path = SCENES / f"{name}.toml") -> np.ndarray:
            scene = wt.load_scene(path, precision)
            return wt.render(scene, spp, boundary=boundary, resolution=(256, 256)).numpy().astype(np.float64)

        reference = image(1024, False, "double")
        errors = {
            "plain": {n: relative(image(n, False), reference) for n in PLAIN},
            "boundary": {n: relative(image(n, True), reference) for n in BOUNDARY},
        }
        beats = [f"{n}: {'yes' if errors['boundary'][n] < errors['plain'][16 * n] else 'NO'}" for n in BOUNDARY]
        for kind, marker in (("plain", "o-"), ("boundary", "s-")):
            spp, values = tuple(errors[kind]), list(errors[kind].values())
            steep = slope(spp, values)
            cells = "".join(f"{value:10.5f}" for value in values) + " " * 10 * (len(PLAIN) - len(values))
            print(f"{name:20}{kind:10}{cells}{steep:8.2f}  {', '.join(beats) if kind == 'boundary' else ''}", flush=True)
            axes[name].plot(spp, values, marker, label=f"{kind}, slope {steep:.2f}")
        axes[name].legend()
    axes[names[0]].set_ylabel("relative RMSE")
    save(figure, folder / "pixels.png")


class Derivative:
    """The derivative of a scene's image by one parameter along one direction, exact and by differences."""

    def __init__(self, scene, name: str) -> None:
        self.scene, self.name = scene, name
        self.value = np.asarray(scene.parameters(name)[name]).ravel()
        direction = np.random.default_rng(zlib.crc32(name.encode())).normal(size=len(self.value))
        self.direction = direction / np.linalg.norm(direction) if len(direction) > 1 else np.ones(1)
        self.step = 1e-2 if name == "camera.fov" else 1e-4

    def exact(self, spp: int) -> np.ndarray:
        import drjit as dr

        import whitted as wt

        # All parameters that the scene uses, so that they share their kernels
        values = dr.detach(self.scene.parameters(*{self.name, *self.scene.nonzero}))
        dr.enable_grad(values)
        for name, value in values.items():
            dr.set_grad(value, type(value)(*self.direction.tolist()) if name == self.name else dr.zeros(type(value)))
        image = wt.render(self.scene.replace(values), spp, resolution=(128, 128))
        return dr.forward_to(image).numpy()

    def differences(self, spp: int, step: float) -> np.ndarray:
        import whitted as wt

        images = []
        for sign in (1, -1):
            moved = self.scene.replace({self.name: self.value + sign * step * self.direction})
            images.append(wt.render(moved, spp, resolution=(128, 128)).numpy())
        return (images[0] - images[1]) / (2 * step)

    @cached_property
    def plain(self):
        """A function from a part of the step to the means of plain samples in a pixel, at points of a Fibonacci lattice.

        They see every edge, whatever its direction, with an error like POINTS^-3/4.
        """
        import drjit as dr
        from drjit.llvm import ad

        from whitted import probe
        from whitted.trace import Limits

        across, along = (np.arange(POINTS) + 0.5) / POINTS, np.arange(POINTS) * ((5**0.5 - 1) / 2) % 1
        size, scene = ad.Array2f64(128, 128), self.scene
        limits = Limits(scene.max_depth, ad.UInt32(scene.max_depth), ad.Float64(scene.min_importance), ad.Float64(1))

        @lru_cache
        def values(factor: float) -> dict:
            moved = scene.replace({self.name: self.value + factor * self.step * self.direction}).parameters()
            dr.make_opaque(moved)
            return moved

        def mean(factor: float, x: int, y: int) -> np.ndarray:
            place = ad.Float64(x + across), ad.Float64(y + along)
            dr.make_opaque(size, limits, place)
            color, _ = probe.samples(scene.shape, values(factor), size, limits, *place)
            return np.array([channel.numpy().mean() for channel in color])[:3]

        return mean

    def pixel(self, x: int, y: int) -> tuple[np.ndarray, np.ndarray]:
        """Plain differences in one pixel, of the step for which they are the most certain, and the same with their error.

        That is how far those of half a step and of a whole one are apart, or those forward and backward, which are not the same
        where an edge comes into the pixel or leaves it.
        """
        found = []
        for step in STEPS:
            means = [self.plain(factor * step, x, y) for factor in (-1, -0.5, 0, 0.5, 1)]
            half, whole = (means[3] - means[1]) / (step * self.step), (means[4] - means[0]) / (2 * step * self.step)
            bend = (means[4] - 2 * means[2] + means[0]) / (step * self.step)
            found.append((half, max(whole - half, bend, key=np.linalg.norm)))
        value, error = min(found, key=lambda pair: np.linalg.norm(pair[1]))
        return value, value + error

    @property
    def bound(self) -> float:
        """Relative error that is allowed: more for what is seen in, or through, a mirror or glass."""
        kind, _, rest = self.name.partition(".")
        shiny = {m.name for m in self.scene.materials if m.reflection.numpy()[0] > 0 or m.refraction.numpy()[0] > 0}
        owner = rest.partition(".")[0]
        if kind in ("spheres", "planes"):
            owner = next(item.material for item in getattr(self.scene, kind) if item.name == owner)
        return 0.1 if kind == "camera" or owner in shiny or self.name.endswith(".ior") else 0.05


def measure(derivative: Derivative) -> dict:
    """The error of one derivative.

    Differences with one step are compared, and those with another tell the reference's own error, which is left out
    (infinite) where the derivative passes with half of its bound. Else pixels where the two steps or the derivative differ
    most have differences of their own.
    """
    row = {"exact": derivative.exact(1), "bound": derivative.bound, "refined": 0, "uncertain": np.inf}
    if not row["exact"].any() and not derivative.differences(1, derivative.step).any():
        return row
    exact, step = derivative.exact(16), derivative.step
    near = derivative.differences(REFERENCE, step)
    if relative(exact, near) > row["bound"] / 2:
        far = derivative.differences(REFERENCE, 2 * step)
        doubt = np.maximum(((exact - near) ** 2).sum(2), ((far - near) ** 2).sum(2))
        for place in np.argsort(doubt.ravel())[: -REFINED - 1 : -1]:
            y, x = divmod(int(place), doubt.shape[1])
            if doubt[y, x] < 1e-4 * (row["bound"] * np.linalg.norm(near)) ** 2:
                break
            small, large = derivative.pixel(x, y)
            if np.linalg.norm(large - small) < np.linalg.norm(far[y, x] - near[y, x]):
                near[y, x], far[y, x] = small, large
                row["refined"] += 1
        row["uncertain"] = relative(far, near)
    return row | {"exact": exact, "reference": near, "error": relative(exact, near)}


def described(name: str, row: dict) -> str:
    """A line of the table."""
    if "error" not in row:
        return f"{name:32}no effect, largest |J| {np.abs(row['exact']).max():.1e}"
    exact, reference = row["exact"], row["reference"]
    total, size = abs(exact.sum() - reference.sum()), np.abs(reference).sum()
    sums = f"{total / max(abs(reference.sum()), 1e-300):10.5f}{total / max(size, 1e-300):10.5f}"
    verdict = "pass" if row["error"] <= row["bound"] else "FAIL"
    known = np.isfinite(row["uncertain"])
    mark = " (reference uncertain)" if known and row["uncertain"] > row["bound"] / 3 else ""
    own = f"{row['uncertain']:11.5f}" if known else f"{'-':>11}"
    return f"{name:32}{row['error']:9.5f}{own}{row['refined']:>9}{sums}{row['bound']:7.2f}  {verdict}{mark}"


def worst(row: dict) -> Iterator[str]:
    """The pixels with the largest errors, and their share of its square."""
    squares = ((row["exact"] - row["reference"]) ** 2).sum(2)
    for place in np.argsort(squares.ravel())[:-6:-1]:
        y, x = divmod(int(place), squares.shape[1])
        values = ", ".join(f"{kind} {np.array2string(row[kind][y, x], precision=4)}" for kind in ("exact", "reference"))
        yield f"    pixel x {x}, y {y}: {100 * squares[y, x] / squares.sum():5.1f} %   {values}"


def gradients(names: list[str], folder: Path, only: str) -> None:
    """Errors of derivatives."""
    import whitted as wt

    figure, axes = panels(names)
    summary = []
    for name in names:
        scene = wt.load_scene(SCENES / f"{name}.toml", "double")
        rows, kinds, start = {}, list(KINDS), time.perf_counter()
        print(f"gradients, {name}, 128 x 128, spp 16: relative L2 error", flush=True)
        print(f"{'parameter':32}{'error':>9}{'reference':>11}{'refined':>9}{'of sum':>10}{'/ sum||':>10}{'bound':>7}")
        for parameter in scene.parameters():
            if not re.search(only, parameter):
                continue
            derivative = Derivative(scene, parameter)
            row = rows[parameter] = measure(derivative)
            print(described(parameter, row), flush=True)
            if "error" not in row:
                continue
            if row["error"] > row["bound"]:
                print(*worst(row), sep="\n", flush=True)
            kind = next((kind for kind in kinds if kind in parameter), None)
            if kind is not None:
                kinds.remove(kind)
                errors = [relative(derivative.exact(spp), row["reference"]) for spp in BOUNDARY[:2]] + [row["error"]]
                steep = slope(BOUNDARY, errors)
                axes[name].plot(BOUNDARY, errors, "o-", label=f"{parameter}, slope {steep:.2f}")
                print("    spp 1, 4, 16:" + "".join(f"{e:9.5f}" for e in errors) + f", slope {steep:.2f}", flush=True)
        axes[name].legend(fontsize=7)
        found = {parameter: row for parameter, row in rows.items() if "error" in row}
        failed = [parameter for parameter, row in found.items() if row["error"] > row["bound"]]
        most = max(found, key=lambda parameter: found[parameter]["error"] / found[parameter]["bound"], default="none")
        error = f"worst {most} {found[most]['error']:.4f}, " if found else ""
        text = f"{name:20}{len(found) - len(failed)} of {len(found)} pass, {error}{len(rows) - len(found)} without effect"
        summary.append(text + "".join(f"\n    FAIL {parameter} {found[parameter]['error']:.4f}" for parameter in failed))
        print(f"{summary[-1]}\n{time.perf_counter() - start:.0f} s\n", flush=True)
    axes[names[0]].set_ylabel("relative L2 error")
    save(figure, folder / "gradients.png")
    print("\n".join(summary), flush=True)


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
        dr.backward(dr.mean(dr.square(wt.render(scene.replace(ours), boundary=boundary) - 0.5), axis=None))
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
        print(f"{name:30}{kernels.compile_seconds:8.2f} s to compile {kernels.compiled} kernels", flush=True)


def kernels(call) -> None:
    """What a call's kernels took."""
    import drjit as dr

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        clock(call)
        history = [entry for entry in dr.kernel_history() if entry["type"] == dr.KernelType.JIT]
    print(f"{sum(entry['execution_time'] for entry in history):.1f} ms in {len(history)} kernels")
    for entry in sorted(history, key=lambda entry: -entry["execution_time"])[:10]:
        print(f"    {entry['execution_time']:8.2f} ms, {entry['size']:>8} lanes, {entry['operation_count']:>6} operations")


def crossings(call) -> int:
    """How many crossings a gradient loop finds."""
    module, found = importlib.import_module("whitted.render"), []
    correct = module.correct

    def counted(band, keep):
        pixels, correction = correct(band, keep)
        found.extend(len(edges.x) for edges in correction.edges)
        return pixels, correction

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
        print(f"{name:30}{value:8.2f} ms (fastest {min(times[name]):.2f}) {ratio}{allowed}", flush=True)
    print(f"{crossings(turns['gradient loop with boundary'])} crossings found")
    for name in bounds:
        print(f"{name}: ", end="")
        kernels(turns[name])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", help="pixels, gradients, cost; all if none")
    parser.add_argument("--scene", action="append", help="only this scene of the folder scenes; may be repeated")
    parser.add_argument("--parameter", default="", help="only parameters in whose names this regular expression is")
    arguments = parser.parse_args()
    parts = arguments.parts or ["pixels", "gradients", "cost"]
    names = arguments.scene or sorted(path.stem for path in SCENES.glob("*.toml"))
    whole = len(names) == len(list(SCENES.glob("*.toml"))) and not arguments.parameter
    folder = HERE.parent / "docs" if whole else Path("out")
    if "pixels" in parts:
        pixels(names, folder)
    if "gradients" in parts:
        gradients(names, folder, arguments.parameter)
    if "cost" in parts:
        cost()
    if "cold" in parts:
        cold()


if __name__ == "__main__":
    main()
