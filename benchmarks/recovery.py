"""How many random problems a fit solves, whether it knows when it has failed, and its error bars.

    recovery.py fits near      60 problems (see recovery_problems.py); also far, farther
    recovery.py bars           errors in units of the bars, over 200 pictures with noise
    recovery.py samples        the same without noise, where samples alone leave errors
    recovery.py many           60 numbers, the positions of 20 balls: both methods

A problem is solved if all numbers are as near as the problem allows. A fit that ends with a lower
loss than that of the truth, and is not near, is told apart: the picture did not tell better.
"""

import argparse
import time
import warnings
from collections.abc import Iterable

import numpy as np
from recovery_problems import DISTANCES, Problem, numbers, problem

import whitted as wt

# Of the pictures for error bars: their side, the noise, and how far their scenes and the starts
# are from the Cornell box, in units of length and of index
SIDE, NOISE, SPREAD, START = 48, 0.02, 0.05, 0.01
NAMES = ["spheres.ball.center", "spheres.ball.radius", "materials.glass.ior"]


def fits(distance: str, chosen: Iterable[tuple[int, Problem]]) -> None:
    """Fit problems of a distance by default, and print one line for each and the shares."""
    solved, called, lower, seconds = [], [], [], []
    for number, one in chosen:
        since = time.monotonic()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = wt.fit(one.start, one.target, wrt=one.names, progress=False)
        seconds.append(time.monotonic() - since)
        solved.append(one.solved(found.scene))
        called.append(found.quality.explained)
        lower.append(found.loss <= one.true_loss())
        print(
            f"{number:3} {one.file:20} noise {one.noise:4} {len(one.allowed)} numbers "
            f"{'solved' if solved[-1] else 'lower' if lower[-1] else 'FAILED'}, "
            f"{'' if called[-1] else 'not '}explained, "
            f"off {one.errors(found.scene).max():.2f} of allowed, tries "
            f"{found.history[-1].attempt}, {seconds[-1]:.1f} s, {', '.join(one.names)}",
            flush=True,
        )
    right, explained = np.array(solved), np.array(called)
    wrong = ~right & ~np.array(lower)
    print(
        f"{distance}: {right.sum()} of {len(right)} solved; "
        f"{(~right & ~wrong).sum()} others have a lower loss than the truth; "
        f"{(wrong & ~explained).sum()} of {wrong.sum()} failures called so; "
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
        found = wt.fit(start, target, wrt=NAMES, levels=1, budget=None, progress=False)
        off = numbers(found.scene, NAMES) - true
        scores.append(np.abs(off) / np.sqrt(found.covariance.diagonal()))
    inside = np.array(scores)
    print(
        f"noise {noise}: of {inside.size} numbers {(inside < 1).mean():.1%} are within one bar, "
        f"{(inside < 1.96).mean():.1%} within 1.96, the largest is off by {inside.max():.1f}"
    )


def many(count: int) -> None:
    """Fit the positions of so many balls, a quarter of a radius off, by both methods."""
    random = np.random.default_rng(1)
    clay = wt.Material("clay", color=(0.7, 0.4, 0.2), specular=0.2)
    board = wt.Checkerboard(color=(0.25, 0.3, 0.4), size=0.5)
    tiles = wt.Material("tiles", color=(0.6, 0.6, 0.6), checker=board)
    places = [(0.8 * (k % 5 - 2), 0.8 * (k // 5) - 1.2, 0) for k in range(count)]
    centers = np.array(places) + random.uniform(-0.1, 0.1, (count, 3))
    truth = wt.Scene(
        camera=wt.Camera(position=(0, 0.3, 6), look_at=(0, 0, 0), fov=40, resolution=(96, 96)),
        spheres=[
            wt.Sphere(f"b{k}", center=c, radius=0.3, material=clay) for k, c in enumerate(centers)
        ],
        planes=[wt.Plane("wall", normal=(0, 0, 1), offset=1.5, material=tiles)],
        lights=[wt.PointLight("key", position=(2, 3, 5), intensity=(0.8, 0.8, 0.8))],
        ambient=(0.2, 0.2, 0.2),
    )
    target = wt.render(truth, 16).numpy()
    target = target + random.normal(scale=0.01, size=target.shape)
    began = centers + random.normal(scale=0.075, size=centers.shape)
    start = truth.replace({f"spheres.b{k}.center": c for k, c in enumerate(began)})
    for method in ("lm", "adam"):
        since = time.monotonic()
        found = wt.fit(start, target, wrt="spheres.*.center", method=method, progress=False)
        off = np.array(list(found.parameters.values())) - centers
        print(
            f"{method}: {centers.size} numbers off by {off.std():.5f} (start {0.075}), "
            f"{found.iterations} iterations, {time.monotonic() - since:.0f} s; {found.quality}",
            flush=True,
        )


def _named(x: np.ndarray) -> dict:
    return {NAMES[0]: x[:3], NAMES[1]: x[3], NAMES[2]: x[4]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["fits", "bars", "samples", "many"])
    parser.add_argument("distance", nargs="?", choices=list(DISTANCES), default="near")
    parser.add_argument(
        "--count", type=int, help="problems or pictures [default: 60, 200], or balls [20]"
    )
    parser.add_argument("--number", type=int, nargs="*", help="only these problems")
    asked = parser.parse_args()
    if asked.what == "fits":
        which = asked.number or range(asked.count or 60)
        fits(asked.distance, ((number, problem(number, asked.distance)) for number in which))
    elif asked.what == "many":
        many(asked.count or 20)
    else:
        bars(asked.count or 200, NOISE if asked.what == "bars" else 0.0)
