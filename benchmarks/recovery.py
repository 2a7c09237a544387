"""How many random problems a fit solves, whether it knows when it has failed, and its error bars.

    recovery.py fits near      60 problems (see recovery_problems.py); also far, farther
    recovery.py bars           errors in units of the bars, over 200 pictures with noise
    recovery.py samples        the same without noise, where samples alone leave errors

A problem is solved if all numbers are as near as the problem allows. It is "called" if the fit says
that the picture is explained, or not explained, and that is right.
"""

import argparse
import time
import warnings

import numpy as np
from recovery_problems import DISTANCES, numbers, problems

import whitted as wt

# Of the pictures for error bars: their side, the noise, and how far their scenes and the starts
# are from the Cornell box, in units of length and of index
SIDE, NOISE, SPREAD, START = 64, 0.02, 0.05, 0.01
NAMES = ["spheres.ball.center", "spheres.ball.radius", "materials.glass.ior"]


def fits(distance: str, count: int) -> None:
    """Fit all problems of a distance by default, and print one line for each and the shares."""
    solved, called, seconds = [], [], []
    for number, one in enumerate(problems(count, distance)):
        since = time.monotonic()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = wt.fit(one.start, one.target, wrt=one.names, progress=False)
        seconds.append(time.monotonic() - since)
        solved.append(one.solved(found.scene))
        called.append(found.quality.explained)
        print(
            f"{number:3} {one.file:20} noise {one.noise:4} {len(one.allowed)} numbers "
            f"{'solved' if solved[-1] else 'FAILED'}, {'' if called[-1] else 'not '}explained, "
            f"off {one.errors(found.scene).max():.2f} of allowed, tries "
            f"{found.history[-1].attempt}, {seconds[-1]:.1f} s, {', '.join(one.names)}",
            flush=True,
        )
    right, explained = np.array(solved), np.array(called)
    print(
        f"{distance}: {right.sum()} of {len(right)} solved; "
        f"{(~right & ~explained).sum()} of {(~right).sum()} failures called so; "
        f"{(right & ~explained).sum()} of {right.sum()} successes called failures; "
        f"median {np.median(seconds):.1f} s, longest {max(seconds):.1f} s"
    )


def bars(count: int, noise: float) -> None:
    """Fit pictures of the Cornell box with its glass ball moved, and print what the bars cover."""
    random, scores = np.random.default_rng(0), []
    scene = wt.load_scene("cornell").replace({"camera.resolution": (SIDE, SIDE)})
    middle = numbers(scene, NAMES)
    for _ in range(count):
        true = middle + random.uniform(-SPREAD, SPREAD, len(middle))
        began = true + random.uniform(-START, START, len(middle))
        truth, start = (scene.replace(_named(x)) for x in (true, began))
        target = wt.render(truth, 16).numpy()
        target = target + random.normal(scale=noise, size=target.shape) if noise else target
        found = wt.fit(start, target, wrt=NAMES, progress=False)
        off = numbers(found.scene, NAMES) - true
        scores.append(np.abs(off) / np.sqrt(found.covariance.diagonal()))
    inside = np.array(scores)
    print(
        f"noise {noise}: of {inside.size} numbers {(inside < 1).mean():.1%} are within one bar, "
        f"{(inside < 1.96).mean():.1%} within 1.96, the largest is off by {inside.max():.1f}"
    )


def _named(x: np.ndarray) -> dict:
    return {NAMES[0]: x[:3], NAMES[1]: x[3], NAMES[2]: x[4]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["fits", "bars", "samples"])
    parser.add_argument("distance", nargs="?", choices=list(DISTANCES), default="near")
    parser.add_argument("--count", type=int, help="problems or pictures [default: 60, 200]")
    asked = parser.parse_args()
    if asked.what == "fits":
        fits(asked.distance, asked.count or 60)
    else:
        bars(asked.count or 200, NOISE if asked.what == "bars" else 0.0)
