"""Measure speed against the yardstick, cold and warm starts, and scaling.

    python benchmarks/speed.py

The yardstick (yardstick.py) is the smallest Dr.Jit kernel that does the same work on the same
scene: an unrolled tree of rays in frozen functions. Calls that are compared take turns in one run.
Times are of the whole call, with synchronisation, once all kernels are compiled, unless a line says
otherwise.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from clock import milliseconds

HERE = Path(__file__).parent
PLACES = [f"spheres.sphere{k}.{field}" for k in range(3) for field in ("center", "radius")]
NAMES = [*PLACES, "materials.mirror.ior", "materials.glass.ior", "materials.green.ior"]
# The first calls compile and warm up: so many of them are left out of the medians
FIRST = 5

# A new process: prints the seconds from its start to its first image and to its first gradient.
# Arguments: the time of the start, the scene file, and the parameters of the gradient.
START = """
import time, os, sys
start = float(sys.argv[1])
import whitted as wt
import drjit as dr
scene = wt.load_scene(sys.argv[2])
image = wt.render(scene, boundary=False)
dr.eval(image)
dr.sync_thread()
print(time.time() - start)
params = scene.parameters(*sys.argv[3:])
dr.enable_grad(params)
dr.backward(dr.mean(dr.square(wt.render(scene.replace(params), boundary=False)), axis=None))
dr.eval(dr.grad(params))
dr.sync_thread()
print(time.time() - start)
"""


def against_yardstick(rounds: int = 40) -> None:
    """The image, and a gradient loop as a user writes it, in turns with the yardstick's."""
    import drjit as dr
    import yardstick

    import whitted as wt

    primal, gradient, params = yardstick.make(512, 5)
    scene = wt.load_scene(HERE / "yardstick.toml")

    def changed() -> dict:
        ours = scene.parameters(*NAMES)
        ours["spheres.sphere0.center"] = ours["spheres.sphere0.center"] + 1e-6
        dr.eval(ours)
        return ours

    def image(ours: dict):
        return wt.render(scene.replace(ours), boundary=False)

    def loop(ours: dict):
        dr.enable_grad(ours)
        loss = dr.mean(dr.square(wt.render(scene.replace(ours), boundary=False) - 0.5), axis=None)
        dr.backward(loss)
        return dr.grad(ours)

    calls = {
        "yardstick, image": lambda: primal(params),
        "yardstick, gradient": lambda: gradient(params),
        "ours, image": lambda: image(changed()),
        "ours, gradient loop": lambda: loop(changed()),
    }
    times: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            times[name].append(milliseconds(call))
    median = {name: statistics.median(values[FIRST:]) for name, values in times.items()}
    for name, values in times.items():
        more = f"fastest {min(values):.2f}, first call, which compiles, {values[0]:.0f}"
        print(f"{name:22}{median[name]:8.2f} ms   ({more})")
    allowed = 1.3 * median["yardstick, image"] + 1
    told = f"allowed 1.3 x yardstick + 1 ms = {allowed:.2f} ms"
    print(f"image:    {median['ours, image']:.2f} ms, {told}")
    allowed = 1.3 * (median["yardstick, image"] + median["yardstick, gradient"]) + 2
    told = f"allowed 1.3 x both yardsticks + 2 ms = {allowed:.2f} ms"
    print(f"gradient: {median['ours, gradient loop']:.2f} ms, {told}")


def steps_of_a_fit(count: int = 200) -> None:
    """One step of a fit, among others that follow each other."""
    import drjit as dr

    import whitted as wt

    cornell = wt.load_scene(HERE.parent / "scenes" / "cornell.toml")
    options = {"resolution": (256, 256), "max_depth": 5}
    # No residual is 0: a pixel without one needs no derivatives
    target = wt.render(cornell, **options) * 0.9 + 0.03
    names = "spheres.ball.center", "spheres.ball.radius", "materials.glass.ior"
    optimiser = dr.opt.Adam(1e-6, params=cornell.parameters(*names))

    def step():
        image = wt.render(cornell.replace(optimiser), **options)
        dr.backward(dr.mean(dr.square(image - target), axis=None))
        optimiser.step()
        return dict(optimiser)

    times = [milliseconds(step) for _ in range(count)]
    median = statistics.median(times[FIRST:])
    label = f"step of a fit, Cornell box, 256 x 256, depth 5: {median:.2f} ms"
    print(f"{label}   (fastest {min(times):.2f}, first, which compiles, {times[0]:.0f})")


def starts() -> None:
    """Seconds from the start of a process to its first image and first gradient."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "DRJIT_CACHE_DIR": cache}
        for name in ("cold", "warm"):
            arguments = [str(time.time()), str(HERE / "yardstick.toml"), *NAMES]
            printed = subprocess.run(
                [sys.executable, "-c", START, *arguments],
                env=environment,
                check=True,
                capture_output=True,
                text=True,
            ).stdout
            image, gradient = map(float, printed.split())
            told = f"first image after {image:.2f} s, first gradient after {gradient:.2f} s"
            print(f"{name} cache: {told}")


def scaling() -> None:
    """Time against pixels, spheres and lights, and the compile time of each first call."""
    import whitted as wt
    from scenes import box
    from whitted.measure.timing import recorded

    def load(text: str):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "scene.toml"
            path.write_text(text)
            return wt.load_scene(path)

    def measure(label: str, scene, per: float, **options) -> None:
        with recorded() as first:
            wt.render(scene, boundary=False, **options)
        warm = statistics.median(
            milliseconds(lambda: wt.render(scene, boundary=False, **options)) for _ in range(9)
        )
        print(f"{label:12}{warm:10.2f} ms {warm / per:12.3f} {first.compile_seconds:10.2f} s")

    print("width               warm   ns a pixel    compile")
    for width in (256, 512, 1024, 2048, 4096):
        measure(f"{width}", load(box()), width * width / 1e6, resolution=(width, width))
    for what in ("spheres", "lights"):
        print(f"{what:12}        warm     ms / {what[:-1]}    compile")
        for count in (1, 2, 4, 8, 16, 32):
            measure(f"{count}", load(box(**{what: count})), count)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        # An empty cache, so that compile times are of compiling and not of loading
        os.environ["DRJIT_CACHE_DIR"] = folder
        # First of all, before this process has threads of its own
        starts()
        against_yardstick()
        steps_of_a_fit()
        scaling()
