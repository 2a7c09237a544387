"""Measure clouds of many spheres: their tree, pictures and gradients.

    python benchmarks/clouds.py [--edges] [--check] NUMBER ...

Each NUMBER is that of evenly spread mirror balls, or a word such as "flake5" for the sphere-flake
of examples/flake.py with so many levels. The picture has 512 x 512 pixels, up to 5 mirrors in a row
and two lights. Times are the least of several calls, once all kernels are compiled. --edges adds
those with edges, which take minutes for many spheres. --check compares the first hits of a million
rays with an exhaustive search in double precision. --peers adds Mitsuba 3 with Embree and POV-Ray
3.7, which trace the same scene in turns with the plain picture; "load" is the time of `load_dict`
and of parsing, "off" tells how many pixels differ from the plain picture by more than 0.01.
"""

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import drjit as dr
import numpy as np
from clock import milliseconds
from cloud_peers import PEERS, in_turns
from drjit.llvm import ad

import whitted as wt
from whitted.core.ray import NONE, Ray
from whitted.shapes import hierarchy
from whitted.tracing.intersect import closest_hit

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from flake import flake, scene_of

SIZE, DEPTH = 512, 5
CENTER, RADIUS = "clouds.balls.center", "clouds.balls.radius"


def spheres_of(what: str) -> np.ndarray:
    """Rows of centers and radii."""
    if what.startswith("flake"):
        return flake(int(what.removeprefix("flake")))
    count = int(what)
    center = np.random.default_rng(0).uniform(-1, 1, (count, 3))
    return np.column_stack([center, np.full(count, 0.6 / count ** (1 / 3))])


def least(call: Callable[[], object], times: int = 3) -> float:
    """The least milliseconds of some calls, after one that compiles."""
    milliseconds(call)
    return min(milliseconds(call) for _ in range(times))


def gradient(scene: wt.Scene, boundary: bool) -> list:
    """The derivatives of the mean of the picture by all centers and radii."""
    values = scene.parameters(CENTER, RADIUS)
    dr.enable_grad(values)
    dr.backward(dr.mean(wt.render(scene.replace(values), boundary=boundary), axis=None))
    return [value.grad for value in values.values()]


def trees(spheres: np.ndarray) -> tuple[float, float]:
    """Seconds to build the tree, and to compute its boxes anew after a small step."""
    rows, members = spheres.astype(np.float32), np.arange(len(spheres))
    start = time.perf_counter()
    tree = hierarchy.build(rows, members)
    built = time.perf_counter()
    again = hierarchy.moved(tree, rows + np.float32(1e-6), members)
    end = time.perf_counter()
    if again.children is not tree.children:
        raise RuntimeError("the tree was built anew after a small step")
    return built - start, end - built


def misses(spheres: np.ndarray, rays: int = 1_000_000) -> int:
    """Rays whose nearest sphere is another one than an exhaustive search finds."""
    # As single precision rounds them
    spheres = spheres.astype(np.float32).astype(float)
    scene = scene_of(spheres, SIZE).remove("planes.ground").astype("double")
    kernel = scene.structure.filled(scene.inputs())
    rng = np.random.default_rng(1)
    o, d = rng.uniform(-1.5, 1.5, (3, rays)), rng.standard_normal((3, rays))
    o, d = ad.Array3f64(o), ad.Array3f64(d / np.linalg.norm(d, axis=0))
    number = dr.full(ad.UInt32, NONE, rays)
    found = closest_hit(kernel, Ray(o, d, number, dr.full(ad.Bool, False, rays)))
    rows = ad.Float64(np.ascontiguousarray(spheres).ravel())

    def compare(k, t):
        c = ad.Array3f64(*(dr.gather(ad.Float64, rows, 4 * k + axis) for axis in range(3)))
        r, to = dr.gather(ad.Float64, rows, 4 * k + 3), c - o
        b = dr.dot(to, d)
        inside = r * r - dr.squared_norm(to - b * d)
        half = dr.sqrt(inside)
        near = dr.select(b - half > 0, b - half, b + half)
        return k + 1, dr.select((inside > 0) & (near > 0) & (near < t), near, t)

    start = dr.zeros(ad.UInt32, rays), dr.full(ad.Float64, dr.inf, rays)
    _, t = dr.while_loop(start, lambda k, _: k < len(spheres), compare, mode="symbolic")
    same = (found.t == t) | (dr.abs(found.t - t) < 1e-9)
    return int(dr.count(~same)[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", nargs="+")
    parser.add_argument("--edges", action="store_true")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--peers", action="store_true")
    asked = parser.parse_args()
    heads = ["spheres", "build", "refit", "plain", "+ interior", *["edges", "right"] * asked.edges]
    heads += [head for name in PEERS for head in (name, "load", "off")] * asked.peers
    print(*(f"{head:>11}" for head in heads))
    for what in asked.what:
        spheres = spheres_of(what)
        scene = scene_of(spheres, SIZE).replace({"max_depth": DEPTH})
        calls = [lambda: wt.render(scene, boundary=False), lambda: gradient(scene, False)]  # noqa: B023
        if asked.edges:
            calls += [lambda: wt.render(scene), lambda: gradient(scene, True)]  # noqa: B023
        seconds = [*trees(spheres), *(least(call) / 1e3 for call in calls)]
        cells = [f"{value:9.3f} s" for value in seconds]
        if asked.peers:
            cells[2], *others = in_turns(scene, len(spheres))
            cells += others
        print(f"{len(spheres):11}", *(f"{cell:>11}" for cell in cells), flush=True)
        if asked.check:
            print(f"rays that miss a sphere: {misses(spheres)} of 1000000")


if __name__ == "__main__":
    main()
