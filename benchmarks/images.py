"""Measure what a picture with edges costs, and what plain samples cost for the same error.

    python benchmarks/images.py [--size N] [SCENE ...]

SCENE is the name of a shipped scene, or `yardstick` [default: all]. N is the number of pixels along
the longer side [default: the scene's own size]. An error is the root mean square of a difference
from 1024 plain samples a pixel. Times are the shortest of some calls. The time that plain samples
need is read off a straight line between two numbers of samples, both on a logarithmic scale. Where
256 of them are not enough, their time is the bound.
"""

import argparse
import time
from functools import partial
from pathlib import Path

import numpy as np
from pareto import scene_file

SCENES = sorted(file.stem for file in (Path(__file__).parent.parent / "scenes").glob("*.toml"))
# Samples along a pixel's side of the plain pictures, and of the reference
SIDES, REFERENCE = (1, 2, 3, 4, 6, 8, 12, 16), 32
# Samples a pixel of the pictures with edges, and calls that are timed
SAMPLES, CALLS = (1, 4), 5
# From so many samples along a side on, one call is timed
LONG = 6


def timed(call, calls: int) -> tuple[np.ndarray, float]:
    """A picture, and the shortest time of some calls, in milliseconds."""
    image, times = call().numpy(), []
    for _ in range(calls):
        start = time.perf_counter()
        call().numpy()
        times.append(time.perf_counter() - start)
    return image, min(times) * 1e3


def compare(name: str, longest: int | None) -> str:
    """The line of the table for one scene."""
    import whitted as wt

    scene = wt.load_scene(scene_file(name))
    factor = longest / max(scene.resolution) if longest else 1
    width, height = (round(side * factor) for side in scene.resolution)
    picture = partial(wt.render, scene, resolution=(width, height))
    sharp = picture(spp=REFERENCE**2, boundary=False).numpy()

    def measured(calls: int, **options) -> tuple[float, float]:
        image, milliseconds = timed(partial(picture, **options), calls)
        return float(np.sqrt(np.mean((image - sharp) ** 2))), milliseconds

    plain = [measured(1 if n >= LONG else CALLS, spp=n * n, boundary=False) for n in SIDES]
    errors, times = np.log(plain[::-1]).T
    cells = [f"{name}, {width} x {height}"]
    for spp in SAMPLES:
        error, milliseconds = measured(CALLS, spp=spp)
        needed = float(np.exp(np.interp(np.log(error), errors, times)))
        beyond = ">" if error < plain[-1][0] else ""
        cells += [f"{error:.5f}", f"{milliseconds:.0f}", f"{beyond}{needed:.0f}"]
        cells.append(f"{beyond}{needed / milliseconds:.2g} x")
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, metavar="N", help="pixels along the longer side")
    parser.add_argument("scenes", nargs="*", metavar="SCENE", default=[*SCENES, "yardstick"])
    given = parser.parse_args()
    kinds = ("error", "ms", "plain, ms", "faster")
    heads = [f"spp {spp}: {kind}" for spp in SAMPLES for kind in kinds]
    print(f"| scene | {' | '.join(heads)} |\n|---|{'--:|' * len(heads)}")
    for name in given.scenes:
        print(compare(name, given.size), flush=True)


if __name__ == "__main__":
    main()
