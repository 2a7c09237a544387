"""Compare the speed of this version with another one.

    python benchmarks/against.py CHECKOUT [ROUNDS]

CHECKOUT is another clone, such as one of commit f173d22. Each version has a process of its own, and
the two take turns, so that a disturbance of the machine slows both. Times are of whole calls, with
synchronisation, once all kernels are compiled: the fastest of all rounds. The first call of each
kind, which compiles (with no kernel in the cache), is told apart.

Then come the costs of edges and of right gradients in plain images of this version, and what they
may be.
"""

import os
import sys
import tempfile
from pathlib import Path

from versions import Version

HERE = Path(__file__).parent
# A name for each scene, its file, and width and height
SCENES = [
    ("yardstick's box", HERE / "yardstick.toml", (512, 512)),
    ("yardstick's box", HERE / "yardstick.toml", (256, 256)),
    *(
        (name, HERE.parent / "scenes" / f"{name}.toml", (256, 256))
        for name in ("cornell", "three_mirror", "whitted1980")
    ),
]
KINDS = ("plain", "plain, 16 samples", "edges", "gradient", "step of Adam")
# Of the box: what a call may take at most, in plain images
ALLOWED = {"edges": 2.5, "gradient": 6.0}

# A process of one version: reads calls, prints milliseconds
CALLS = """
import json, sys, time
sys.path.insert(0, sys.argv[1])
import drjit as dr
import whitted as wt

ENDS = (".center", ".radius", ".ior")
scenes, optimisers = {}, {}

def call(file, size, kind):
    scene = scenes.setdefault(file, wt.load_scene(file))
    options = {"resolution": tuple(size)}
    start = time.perf_counter()
    if kind.startswith("plain"):
        dr.eval(wt.render(scene, spp=16 if "16" in kind else 1, boundary=False, **options))
    elif kind == "edges":
        dr.eval(wt.render(scene, **options))
    elif kind == "gradient":
        values = {k: v for k, v in scene.parameters().items() if k.endswith(ENDS)}
        dr.enable_grad(values)
        image = wt.render(scene.replace(values), **options)
        dr.backward(dr.mean(dr.square(image - 0.3), axis=None))
        dr.eval(dr.grad(values))
    else:
        names = [name for name in scene.parameters() if name.endswith(ENDS)][:3]
        optimiser = optimisers.setdefault(file, dr.opt.Adam(1e-6, scene.parameters(*names)))
        image = wt.render(scene.replace(optimiser), **options)
        dr.backward(dr.mean(dr.square(image - 0.3), axis=None))
        optimiser.step()
        dr.eval(dict(optimiser))
    dr.sync_thread()
    return (time.perf_counter() - start) * 1e3

for line in sys.stdin:
    print(call(*json.loads(line)), flush=True)
"""


def compare(versions: list[Version], rounds: int) -> dict[tuple, float]:
    """Print a line for each call, and return this version's fastest times."""
    fastest = {}
    print(f"{'':46}{'now':>9}{'before':>9}{'ratio':>7}   first calls")
    for name, file, size in SCENES:
        for kind in KINDS:
            asked = str(file), size, kind
            first = [version.ask(*asked) / 1e3 for version in versions]
            turns = [[version.ask(*asked) for version in versions] for _ in range(rounds)]
            now, before = (min(times) for times in zip(*turns, strict=True))
            fastest[name, size, kind] = now
            label = f"{name}, {size[0]} x {size[1]}, {kind}"
            print(
                f"{label:46}{now:9.2f}{before:9.2f}{now / before:7.2f}   "
                f"{first[0]:.2f} s, {first[1]:.2f} s",
                flush=True,
            )
    return fastest


def main() -> None:
    if not 2 <= len(sys.argv) <= 3:
        sys.exit(__doc__)
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 30
    with tempfile.TemporaryDirectory() as own:
        caches = [f"{own}/{which}" for which in ("now", "before")]
        for cache in caches:
            os.mkdir(cache)
        folders = HERE.parent, Path(sys.argv[1])
        versions = [
            Version(folder, CALLS, DRJIT_CACHE_DIR=cache)
            for folder, cache in zip(folders, caches, strict=True)
        ]
        fastest = compare(versions, rounds)
        for version in versions:
            version.process.kill()
    for name, _, size in SCENES[:2]:
        for kind, most in ALLOWED.items():
            ratio = fastest[name, size, kind] / fastest[name, size, "plain"]
            label = f"{name}, {size[0]} x {size[1]}, {kind}"
            print(f"{label}: {ratio:.1f} plain images, allowed {most} at 512 x 512")


if __name__ == "__main__":
    main()
