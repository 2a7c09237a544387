"""A finger before the lens: what the scene lacks is found, masked out, and does not pull."""

import numpy as np
from common import SCENES, arguments, recover

import whitted as wt

NOISE = 0.01

if __name__ == "__main__":
    asked = arguments(__doc__)
    truth = wt.load_scene(SCENES / "cornell.toml")
    skin = wt.Material("skin", color=(0.8, 0.5, 0.4))
    finger = wt.Sphere("finger", center=(0.14, -0.2, 2.6), radius=0.08, material=skin)
    size = (asked.size, asked.size)
    target = wt.render(truth.add(finger), 16, resolution=size).numpy()
    target = target + np.random.default_rng(1).normal(scale=NOISE, size=target.shape)
    options = {"target": target, "plain": False, "budget": 5}
    start = {"spheres.ball.center": [0.28, -0.50, 0.54]}
    # By squares alone the finger pulls, and the fit says that something is left
    pulled, _ = recover("Finger", truth, start, asked.size, asked.output, **options)
    print(pulled.quality)
    found, _ = recover(
        "Finger and robust loss", truth, start, asked.size, asked.output, robust="cauchy", **options
    )
    # Pixels that are off by more than noise is, once in 10^6, and their neighbours
    left = wt.render(found.scene, 4, resolution=size).numpy() - target
    wide = np.pad(np.abs(left).max(2) > 5 * found.quality.noise, 1)
    rows, columns = range(3), range(3)
    shifts = [wide[j : j + asked.size, i : i + asked.size] for j in rows for i in columns]
    mask = ~np.any(shifts, axis=0)
    wt.write_image(asked.output / "finger-mask.png", np.repeat(1.0 * mask[..., None], 3, 2))
    masked, _ = recover(
        "Finger masked out", truth, start, asked.size, asked.output, mask=mask, **options
    )
    print(masked.quality)
