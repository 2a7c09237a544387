"""A glass ball in noisy pictures: do the error bars cover the true numbers?"""

import numpy as np
from common import SCENES, arguments, numbers, recover

import whitted as wt

if __name__ == "__main__":
    asked = arguments(__doc__)
    truth = wt.load_scene(SCENES / "cornell.toml")
    start = {"spheres.ball.center": [0.21, -0.57, 0.46], "materials.glass.ior": 1.55}
    clean = wt.render(truth, 16, resolution=(asked.size, asked.size)).numpy()
    for percent in (1, 5, 10):
        random = np.random.default_rng(percent)
        noisy = clean + random.normal(scale=percent / 100, size=clean.shape)
        title = f"Noise of {percent} percent"
        result, _ = recover(title, truth, start, asked.size, asked.output, target=noisy)
        found = np.array([(value, deviation) for _, value, deviation in result.numbers()])
        print(
            "errors in standard deviations:",
            np.round((found[:, 0] - numbers(truth, start)) / found[:, 1], 2),
        )
