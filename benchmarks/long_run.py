"""Render and optimise for long, and check that nothing piles up and nothing drifts.

    python benchmarks/long_run.py [--renders 10000] [--steps 2000]

Prints how much the process's memory grew once it was warm, how many kernels were compiled
meanwhile, and how far the last result is from the first. The exit status is 1 where memory grew by
20 MiB or more, a kernel was compiled, or the results differ.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import drjit as dr
import numpy as np
from drjit.opt import Adam

import whitted as wt
from whitted.measure.timing import recorded

SCENE = Path(__file__).parent.parent / "scenes" / "three_mixed.toml"
# Pixels of an image: few, as it is the number of calls that counts here
SIZE = (16, 16)
# Rounds before memory is read for the first time
WARM = 200
# Compiled kernels are counted in one of so many rounds, as counting them takes time
CHECKED = 100
# Steps after which the optimisation begins anew
RESTART = 100
MIB = 1 << 20
# Growth of memory, in MiB, from which on something is taken to pile up
GROWTH = 20


def resident() -> float:
    """Memory of this process, in MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / MIB


def ball(scene: wt.Scene) -> str:
    """The name of the parameter that moves: the first sphere's centre."""
    first = next(shape for shape in scene.shapes if shape.group == "spheres")
    return f"spheres.{first.name}.center"


def renderer(scene: wt.Scene) -> Callable[[int], np.ndarray]:
    """A function that renders the scene with a ball at another place for each number."""
    name = ball(scene)
    center = np.ravel(scene.parameters(name)[name].numpy())

    def render(k: int) -> np.ndarray:
        moved = center + 0.1 * np.sin([k, 2 * k, 3 * k])
        return wt.render(scene.replace({name: moved}), resolution=SIZE).numpy()

    return render


def optimiser(scene: wt.Scene) -> Callable[[int], np.ndarray]:
    """A function that takes a step towards an image, and returns the gradient."""
    name = ball(scene)
    target = wt.render(scene, resolution=SIZE)
    first = scene.parameters(name)[name] + 0.05
    opt = Adam(lr=1e-3, params={name: first})

    def step(k: int) -> np.ndarray:
        if k % RESTART == 0:
            opt.reset(name)
            opt[name] = first
        image = wt.render(scene.replace(opt), resolution=SIZE)
        dr.backward(dr.mean(dr.square(image - target), axis=None))
        gradient = np.ravel(dr.grad(opt[name]).numpy())
        opt.step()
        return gradient

    return step


def run(name: str, function: Callable[[int], np.ndarray], rounds: int) -> bool:
    """Call a function with 0, 1, 2, ... and at the end with 0 again, and print what came of it.

    Returns:
        Whether all is well.
    """
    first = function(0)
    for k in range(1, WARM):
        function(k)
    before, compiled, start = resident(), 0, time.perf_counter()
    for k in range(WARM, WARM + rounds):
        if k % CHECKED == CHECKED - 1:
            with recorded() as kernels:
                function(k)
            compiled += kernels.compiled
        else:
            function(k)
    seconds, growth = time.perf_counter() - start, resident() - before
    last = function(0)
    # A gradient's sums over pixels may be added up in another order
    error = abs(last - first).max() / abs(first).max()
    memory = f"memory {before:.0f} MiB and {growth:+.1f}"
    print(f"{name}: {rounds} in {seconds:.0f} s, {memory}, {compiled} compiled,", end=" ")
    print(f"last differs from first by {error:.1e}", flush=True)
    return growth < GROWTH and compiled == 0 and error <= 1e-6


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--renders", type=int, default=10_000, help="images to render")
    parser.add_argument("--steps", type=int, default=2000, help="steps of an optimiser to take")
    options = parser.parse_args()
    scene = wt.load_scene(SCENE)
    well = [
        run("renders", renderer(scene), options.renders),
        run("steps", optimiser(scene), options.steps),
    ]
    return int(not all(well))


if __name__ == "__main__":
    sys.exit(main())
