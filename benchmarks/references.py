"""Sharp derivatives of images, to hold others against.

    python benchmarks/references.py SCENE STEP NAME[.COMPONENT]... [--points N]

Central differences of plain samples in double precision: two sets of N points in every pixel that
has an edge (32768, if not given), and of 256 in the others. The mean is written to
results/references/, with its own error: half of how far apart the results of the two sets are.

The step has to be small. An edge that moves from one pixel into the next within it changes both,
which no second step can put right. With 0.0005, as most of the kept ones have, edges move by
some hundredths of a pixel.

The points are a rank-1 sequence. Source: M. Roberts, "The Unreasonable Effectiveness of
Quasirandom Sequences" (2018).

The scene is traced with 128 pixels along the longer side. One derivative takes minutes.
"""

import argparse
import time
from pathlib import Path

import drjit as dr
import numpy as np
from drjit.llvm import ad

import whitted as wt
from whitted.core.host import stacked, to_numpy
from whitted.core.pytree import Apart
from whitted.edges import kernels
from whitted.sampling.band import Band
from whitted.tracing.node import Limits

FOLDER = Path(__file__).parent.parent / "results" / "references"
LONGER = 128
# Samples along the side of a pixel to look for edges; points where there are none
LOOK, SMOOTH = 8, 256
# Points that are traced at once
LANES = 1 << 20
# The root of x^3 = x + 1
RATIO = 1.32471795724474602596


def resolution(scene: wt.Scene) -> tuple[int, int]:
    """A size with the scene's proportions, and `LONGER` pixels along the longer side."""
    longest = max(scene.resolution)
    width, height = (max(1, round(side * LONGER / longest)) for side in scene.resolution)
    return width, height


def band_of(scene: wt.Scene, side: int) -> Band:
    """The whole image as one band; no ray is too faint for it."""
    values = scene.inputs()
    dr.make_opaque(values)
    least = scene.min_importance
    limits = Limits(
        max(8, 1 << (scene.max_depth - 1).bit_length()),
        dr.opaque(ad.UInt32, scene.max_depth),
        dr.opaque(ad.Float64, least) if least > 0 else None,
        dr.opaque(ad.Float64, 0),
    )
    size = resolution(scene)
    return Band(scene.structure, Apart(values), limits, size, 0, size[1], side)


def has_edge(scene: wt.Scene) -> np.ndarray:
    """Bool for each pixel: its samples, or those right beside it, have several labels."""
    band = band_of(scene, LOOK)
    inputs = band.structure, band.parameters, band.film(margin=1), band.limits
    _, labels = kernels.labelled_image(*inputs)
    width, height = band.resolution
    grid = labels.numpy().reshape((height + 2) * LOOK, (width + 2) * LOOK)
    window = np.lib.stride_tricks.sliding_window_view(grid, (LOOK + 2, LOOK + 2))
    own = window[LOOK - 1 :: LOOK, LOOK - 1 :: LOOK][:height, :width].reshape(height, width, -1)
    return (own != own[..., :1]).any(-1).ravel()


def means(scene: wt.Scene, pixels: np.ndarray, points: int, seed: int) -> np.ndarray:
    """The means of some points in some pixels: (N, 3)."""
    band, number = band_of(scene, 1), np.arange(points)
    shift = np.random.default_rng(seed).random(2)
    right, down = (shift[0] + number / RATIO) % 1, (shift[1] + number / RATIO**2) % 1
    result, most = np.empty((len(pixels), 3)), LANES // points
    for start in range(0, len(pixels), most):
        row, column = np.divmod(pixels[start : start + most, None], band.resolution[0])
        place = band.lanes((column + right).ravel(), (row + down).ravel())
        color, _ = kernels.labelled_samples(*band.inputs, *place, dr.opaque(ad.Bool, False))
        seen = stacked(to_numpy(color), slice(row.size * points))
        result[start : start + len(row)] = seen.reshape(3, -1, points).mean(-1).T
    return result


def reference(scene: wt.Scene, name: str, axis: int, step: float, points: int) -> tuple:
    """The derivative of the image by one number, and its own error, relative to its norm."""
    value = np.array(scene.parameters(name)[name]).ravel()
    moved = {}
    for sign in (1, -1):
        there = value.copy()
        there[axis] += sign * step
        moved[sign] = scene.replace({name: there if len(there) > 1 else there[0]})
    edge = has_edge(moved[1]) | has_edge(moved[-1])
    width, height = resolution(scene)

    def differences(seed: int) -> np.ndarray:
        change = np.empty((edge.size, 3))
        for which, count in ((edge, points), (~edge, SMOOTH)):
            pixels = np.flatnonzero(which)
            ahead, back = (means(moved[sign], pixels, count, seed) for sign in (1, -1))
            change[pixels] = ahead - back
        return (change / (2 * step)).reshape(height, width, 3)

    one, other = differences(1), differences(2)
    best = (one + other) / 2
    return best, np.linalg.norm(one - other) / 2 / np.linalg.norm(best)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("step", type=float)
    parser.add_argument("names", nargs="+")
    parser.add_argument("--points", type=int, default=32768)
    given = parser.parse_args()
    scene = wt.load_scene(given.scene, precision="double")
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = FOLDER / f"{given.scene.stem}.npz"
    kept = dict(np.load(file)) if file.exists() else {}
    for full in given.names:
        start = time.time()
        name, _, component = full.rpartition(".")
        axis = "xyz".find(component) if len(component) == 1 else -1
        image, error = reference(
            scene, name if axis >= 0 else full, max(axis, 0), given.step, given.points
        )
        kept[full], kept[f"{full} error"] = image.astype(np.float16), np.float32(error)
        np.savez_compressed(file, **kept)
        taken = time.time() - start
        print(f"{given.scene.stem} {full}: own error {error:.4f}, {taken:.0f} s", flush=True)


if __name__ == "__main__":
    main()
