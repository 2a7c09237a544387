"""A small network guesses the index and the position of a glass ball; a fit refines the guess.

A sweep renders the pictures that the network learns from. The network is two layers in NumPy. Needs
the extra `cluster`.
"""

import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import zarr
from common import SCENES, arguments

import whitted as wt
from whitted import cluster

IOR, CENTER = "materials.glass.ior", "spheres.ball.center"
RANGES = {IOR: (1.3, 1.8), f"{CENTER}.x": (-0.1, 0.4), f"{CENTER}.z": (0.2, 0.6)}
# Pictures to learn from, hidden numbers, passes over the pictures, pictures in a step
PICTURES, HIDDEN, PASSES, STEP = 512, 64, 60, 32
# The network looks at pictures of so many pixels along a side
SIDE = 16


def learned(inputs, outputs, random):
    """A network: weights and offsets of two layers, by Adam on the squares of its errors."""
    sizes = (inputs.shape[1], HIDDEN, outputs.shape[1])
    layers = [
        part
        for n, m in pairwise(sizes)
        for part in (random.normal(0, n**-0.5, (n, m)), np.zeros(m))
    ]
    means = [np.zeros_like(part) for part in layers]
    squares = [np.zeros_like(part) for part in layers]
    steps = 0
    for number in range(PASSES):
        rate = 2e-3 * (1 - number / PASSES)
        for some in np.array_split(random.permutation(len(inputs)), len(inputs) // STEP):
            x, y, steps = inputs[some], outputs[some], steps + 1
            hidden, guess = answers(layers, x)
            error = 2 * (guess - y) / y.size
            back = (error @ layers[2].T) * (1 - hidden**2)
            slopes = x.T @ back, back.sum(0), hidden.T @ error, error.sum(0)
            for part, slope, mean, square in zip(layers, slopes, means, squares, strict=True):
                mean += 0.1 * (slope - mean)
                square += 0.001 * (slope**2 - square)
                size = np.sqrt(square / (1 - 0.999**steps)) + 1e-8
                part -= rate * mean / (1 - 0.9**steps) / size
    return layers


def answers(layers, x):
    """The hidden numbers of a network, and what it answers."""
    hidden = np.tanh(x @ layers[0] + layers[1])
    return hidden, hidden @ layers[2] + layers[3]


def seen(pictures):
    """What the network sees of pictures: logarithms, so that dark pixels count as well."""
    return np.log1p(8 * np.asarray(pictures, float)).reshape(len(pictures), -1)


if __name__ == "__main__":
    asked = arguments(__doc__, 96)
    asked.output.mkdir(parents=True, exist_ok=True)
    scene, random = wt.load_scene(SCENES / "cornell.toml"), np.random.default_rng(0)

    # Pictures, and the numbers that they are of
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "balls.zarr"
        cluster.sweep(scene, RANGES, path, count=PICTURES, resolution=(SIDE, SIDE), spp=1)
        data = zarr.open_group(str(path), mode="r")
        inputs, numbers = seen(data["image"][:]), np.stack([data[name][:] for name in RANGES], 1)
    low, high = np.array(list(RANGES.values())).T
    middle, spread = inputs.mean(0), inputs.std(0) + 0.02
    layers = learned((inputs - middle) / spread, 2 * (numbers - low) / (high - low) - 1, random)

    # A picture that it has not seen, of another size
    true = {IOR: 1.62, CENTER: (0.21, -0.61, 0.37)}
    target = wt.render(scene.replace(true), 4, resolution=(asked.size, asked.size))
    small = wt.render(scene.replace(true), 1, resolution=(SIDE, SIDE)).numpy()
    _, answer = answers(layers, (seen(small[None]) - middle) / spread)
    ior, x, z = np.clip(low + (high - low) * (answer[0] + 1) / 2, low, high)
    guess = {IOR: ior, CENTER: (x, -0.61, z)}

    found = wt.fit(
        scene.replace(guess), target, wrt=[IOR, CENTER], resolution=(asked.size, asked.size)
    )
    ends = found.parameters
    print("number                        true     guess     found")
    rows = [(IOR, true[IOR], ior, ends[IOR])]
    rows += [
        (f"{CENTER}.{axis}", true[CENTER][k], guess[CENTER][k], ends[CENTER][k])
        for k, axis in enumerate("xyz")
    ]
    for name, *values in rows:
        print(f"{name:24} " + " ".join(f"{value:9.5f}" for value in values))
    print(found.quality)
    wt.write_image(asked.output / "guess-target.png", target)
    wt.write_image(asked.output / "guess-found.png", wt.render(found.scene, 4))
