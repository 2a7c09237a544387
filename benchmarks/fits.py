"""Compare the fits of this version with those of another one.

    python benchmarks/fits.py CHECKOUT [STARTS]

CHECKOUT is a clone of another version, such as commit f173d22. Each version has a process of its
own, and the two take turns. Each scene is fitted from some starts (three, if not given) by default;
the target has 16 samples a pixel. Times are medians, once all kernels are compiled. Errors are the
greatest of any number and start, in units of length and of the index.
"""

import statistics
import sys
from pathlib import Path

from pareto import scene_file
from versions import Version

HERE = Path(__file__).parent
# Scenes, pixels along the longer side, and what is fitted
FITS = {
    "yardstick": (128, "spheres.sphere0.center", "spheres.sphere0.radius"),
    "cornell": (96, "spheres.ball.center", "spheres.mirror.radius", "materials.glass.ior"),
    "three_diffuse": (96, "spheres.large.center", "spheres.small.radius"),
    "three_mirror": (96, "spheres.medium.center", "spheres.large.radius"),
    "three_glass": (96, "spheres.medium.center", "materials.glass.ior"),
    "three_mixed": (96, "spheres.medium.center", "spheres.large.radius"),
    "mirrors": (96, "spheres.a.center", "spheres.b.radius"),
    "glass_pair": (80, "spheres.first.center", "materials.glass.ior"),
    "nested": (80, "spheres.bubble.center", "materials.glass.ior"),
    "whitted1980": (80, "spheres.glass.center", "materials.glass.ior"),
}
# How far starts are from the truth: a part of a ball's radius, and an amount of the index
LENGTH, INDEX = 0.1, 0.04

# A process of one version: reads fits, prints seconds and errors
CALLS = """
import json, sys, time, warnings
sys.path.insert(0, sys.argv[1])
import numpy as np
import whitted as wt

warnings.simplefilter("ignore")

def numbers(value):
    return np.array(value, float).ravel()

def fit(file, longer, names, seed):
    scene, random = wt.load_scene(file), np.random.default_rng(seed)
    longest = max(scene.resolution)
    size = tuple(round(side * longer / longest) for side in scene.resolution)
    true, start = scene.parameters(), {}
    for name in names:
        value = numbers(true[name])
        far = INDEX
        if not name.endswith(".ior"):
            far = LENGTH * numbers(true[name.replace(".center", ".radius")])[0]
        value += far * random.choice([-1, 1], value.size) * random.uniform(0.5, 1, value.size)
        start[name] = value.tolist() if value.size > 1 else value[0]
    target = wt.render(scene, resolution=size, spp=16)
    begin = scene.replace(start)
    since = time.perf_counter()
    found = wt.fit(begin, target, wrt=names, resolution=size, progress=False)
    seconds, after = time.perf_counter() - since, found.scene.parameters()
    off = max(float(abs(numbers(after[name]) - numbers(true[name])).max()) for name in names)
    return seconds, off

for line in sys.stdin:
    print(json.dumps(fit(*json.loads(line))), flush=True)
"""


def main() -> None:
    if not 2 <= len(sys.argv) <= 3:
        sys.exit(__doc__)
    starts = int(sys.argv[2]) if len(sys.argv) > 2 else 3
    code = f"LENGTH, INDEX = {LENGTH}, {INDEX}\n" + CALLS
    versions = [Version(folder, code) for folder in (HERE.parent, Path(sys.argv[1]))]
    print("| scene | now, s | before, s | faster | error now | error before |")
    print("|---|--:|--:|--:|--:|--:|")
    gains = []
    for name, (longer, *names) in FITS.items():
        asked = str(scene_file(name)), longer, names
        for version in versions:
            version.ask(*asked, 0)
        turns = [[version.ask(*asked, seed) for version in versions] for seed in range(starts)]
        seconds, off = zip(*(zip(*of, strict=True) for of in zip(*turns, strict=True)), strict=True)
        now, before = map(statistics.median, seconds)
        gains.append(before / now)
        errors = " | ".join(f"{max(own):.5f}" for own in off)
        size = f"{name}, {longer} pixels"
        print(f"| {size} | {now:.2f} | {before:.2f} | {gains[-1]:.1f} x | {errors} |", flush=True)
    print(f"\nMedian: {statistics.median(gains):.1f} times as fast")
    for version in versions:
        version.process.kill()


if __name__ == "__main__":
    main()
