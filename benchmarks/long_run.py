"""Render and optimise for long, and check that nothing piles up and nothing drifts.

    python benchmarks/long_run.py [--renders 10000] [--steps 2000] [--scenes 2000]

For renders and steps of one scene it prints how much the process's memory grew once it was warm,
how many kernels were compiled meanwhile, and how far the last result is from the first. Then it
makes many scenes of 200 structures, one in twenty of which has edges and is differentiated, and
prints memory every 100 scenes. The exit status is 1 where memory grew by 20 MiB or more (for the
many scenes: in 1000 of them), where a kernel was compiled, or where the results differ.
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
# Structures of the scenes that are made, and rounds through all of them before growth is measured
STRUCTURES = 200
WARM_ROUNDS = 2
# One structure in so many is rendered with edges, and differentiated
DIFFERENTIATED = 20
# Scenes after which memory is printed
PRINTED = 100
MATERIALS: tuple[dict[str, float | bool], ...] = (
    {},
    {"specular": 0.4},
    {"reflection": 0.5},
    {"reflection": 0.3, "fresnel": True},
    {"reflection": 0.9, "refraction": 0.9},
    {"reflection": 1, "refraction": 1, "fresnel": True, "shadow": 0.5},
)
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


def structures(count: int) -> list[tuple[tuple[int, ...], ...]]:
    """Different structures: for each sphere, plane and light a number that tells its kind."""
    rng = np.random.default_rng(1)
    found: dict[tuple[tuple[int, ...], ...], None] = {}
    while len(found) < count:
        spheres, planes, lights = rng.integers((1, 0, 1), (6, 3, 3))
        kinds = len(MATERIALS), len(MATERIALS), 2
        each = zip((spheres, planes, lights), kinds, strict=True)
        found[tuple(tuple(rng.integers(0, kind, n).tolist()) for n, kind in each)] = None
    return list(found)


def generated(structure: tuple[tuple[int, ...], ...], rng: np.random.Generator) -> wt.Scene:
    """A scene of a structure, with random numbers."""
    spheres, planes, lights = structure

    def material(kind: int) -> wt.Material:
        name = f"m{rng.integers(1 << 40)}"
        return wt.Material(name, color=rng.uniform(0.1, 0.9, 3), **MATERIALS[kind])

    return wt.Scene(
        camera=wt.Camera(
            position=(0, 0, 6), look_at=rng.uniform(-0.1, 0.1, 3), fov=50, resolution=SIZE
        ),
        spheres=[
            wt.Sphere(
                f"ball {k}",
                center=rng.uniform(-1.2, 1.2, 3),
                radius=rng.uniform(0.2, 0.6),
                material=material(kind),
            )
            for k, kind in enumerate(spheres)
        ],
        planes=[
            wt.Plane(
                f"wall {k}",
                normal=(-k, 1 - k, 0.1 * rng.random()),
                offset=rng.uniform(1.5, 2),
                material=material(kind),
            )
            for k, kind in enumerate(planes)
        ],
        lights=[
            wt.PointLight(
                f"lamp {k}",
                position=rng.uniform((-2, 2, 2), (2, 4, 4)),
                intensity=rng.uniform(0.5, 1, 3),
                falloff=("none", "inverse-square")[kind],
            )
            for k, kind in enumerate(lights)
        ],
    )


def run_scenes(count: int) -> bool:
    """Render many generated scenes, and print memory meanwhile.

    Returns:
        Whether all is well.
    """
    every, rng = structures(STRUCTURES), np.random.default_rng(2)
    first, memory, start = np.empty(0), [], time.perf_counter()
    for k in range(count):
        if k % STRUCTURES == 0:
            order = rng.permutation(STRUCTURES)
        which = int(order[k % STRUCTURES])
        scene = generated(every[which], rng)
        if which % DIFFERENTIATED == 0:
            values = scene.parameters("spheres.*.center")
            dr.enable_grad(values)
            image = wt.render(scene.replace(values))
            dr.backward(dr.mean(dr.square(image), axis=None))
            dr.eval(dr.grad(values))
        else:
            image = wt.render(scene, boundary=False)
        pixels = image.numpy()
        if k == 0:
            kept, first = (scene, which % DIFFERENTIATED == 0), pixels
        if k % PRINTED == PRINTED - 1:
            memory.append(resident())
            seconds = time.perf_counter() - start
            print(f"{k + 1} scenes in {seconds:.0f} s, memory {memory[-1]:.0f} MiB", flush=True)
    same = np.array_equal(wt.render(kept[0], boundary=kept[1]).numpy(), first)
    warm = memory[WARM_ROUNDS * STRUCTURES // PRINTED :]
    growth = np.polyfit(np.arange(len(warm)) * PRINTED / 1000, warm, 1)[0]
    print(f"scenes: memory {warm[0]:.0f} MiB and {growth:+.1f} in 1000 scenes,", end=" ")
    print(f"the first scene's image is {'' if same else 'NOT '}the same", flush=True)
    return bool(growth < GROWTH) and same


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--renders", type=int, default=10_000, help="images to render")
    parser.add_argument("--steps", type=int, default=2000, help="steps of an optimiser to take")
    parser.add_argument("--scenes", type=int, default=2000, help="scenes to make")
    options = parser.parse_args()
    scene = wt.load_scene(SCENE)
    well = [
        run("renders", renderer(scene), options.renders),
        run("steps", optimiser(scene), options.steps),
        run_scenes(options.scenes),
    ]
    return int(not all(well))


if __name__ == "__main__":
    sys.exit(main())
