"""Run for long: many renders and many steps of an optimisation, and what they leave behind.

Prints the growth of the process's memory after warming up, the kernels that were compiled
meanwhile, and whether the last result is the first one again. Exit status 1 where memory grew by 20
MiB, anything was compiled, or a result differs.

    python benchmarks/long_run.py [--renders 10000] [--steps 2000]
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
from whitted.timing import recorded

import whitted as wt

SCENE = Path(__file__).parent.parent / "scenes" / "three_mixed.toml"
SIZE = (16, 16)
WARM = 200
EVERY = 100  # rounds of which one is searched for compiled kernels
MIB = 1 << 20


def resident() -> float:
    """Memory of this process, in MiB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / MIB


def renderer(scene: wt.Scene) -> Callable[[int], np.ndarray]:
    """A function that renders the scene with a ball somewhere else each time."""
    name = scene.spheres[0].name
    center = np.ravel(scene.parameters(f"spheres.{name}.center")[f"spheres.{name}.center"].numpy())

    def render(k: int) -> np.ndarray:
        moved = center + 0.1 * np.sin([k, 2 * k, 3 * k])
        return wt.render(scene.replace({f"spheres.{name}.center": moved}), resolution=SIZE).numpy()

    return render


def optimiser(scene: wt.Scene) -> Callable[[int], np.ndarray]:
    """A function that takes a step towards an image, begun anew every hundred steps, and returns
    the gradients.
    """
    name = f"spheres.{scene.spheres[0].name}.center"
    target = wt.render(scene, resolution=SIZE)
    first = scene.parameters(name)[name] + 0.05
    opt = Adam(lr=1e-3, params={name: first})

    def step(k: int) -> np.ndarray:
        if k % EVERY == 0:
            opt.reset(name)
            opt[name] = first
        image = wt.render(scene.replace(opt), resolution=SIZE)
        dr.backward(dr.mean(dr.square(image - target), axis=None))
        gradient = np.ravel(dr.grad(opt[name]).numpy())
        opt.step()
        return gradient

    return step


def run(name: str, function: Callable[[int], np.ndarray], rounds: int) -> bool:
    """Run a function for 0, 1, 2, ... and 0 again, and report; returns whether all is well."""
    first = function(0)
    for k in range(1, WARM):
        function(k)
    before, compiled, start = resident(), 0, time.perf_counter()
    for k in range(WARM, WARM + rounds):
        if k % EVERY == EVERY - 1:
            with recorded() as kernels:
                function(k)
            compiled += kernels.compiled
        else:
            function(k)
    seconds, growth = time.perf_counter() - start, resident() - before
    last = function(0)
    # Sums of a gradient over pixels may be added in another order
    error = abs(last - first).max() / abs(first).max()
    print(
        f"{name}: {rounds} in {seconds:.0f} s, memory {before:.0f} MiB and {growth:+.1f}, {compiled} compiled,",
        end=" ",
    )
    print(f"last differs from first by {error:.1e}", flush=True)
    return growth < 20 and compiled == 0 and error <= 1e-6


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--renders", type=int, default=10_000)
    parser.add_argument("--steps", type=int, default=2000)
    options = parser.parse_args()
    scene = wt.load_scene(SCENE)
    well = [
        run("renders", renderer(scene), options.renders),
        run("steps", optimiser(scene), options.steps),
    ]
    return int(not all(well))


if __name__ == "__main__":
    sys.exit(main())
