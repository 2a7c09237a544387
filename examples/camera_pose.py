"""Where a camera was and where it looked, from a picture of a known scene.

How far away the point is that it looked at cannot be told: its error bar says so, and the direction
is what counts.
"""

import numpy as np
from common import SCENES, arguments, numbers, recover

import whitted as wt

if __name__ == "__main__":
    asked = arguments(__doc__)
    truth = wt.load_scene(SCENES / "cornell.toml")
    start = {"camera.position": [0.15, 0.1, 3.2], "camera.look_at": [0.05, 0.02, 0.0]}
    ours, theirs = recover("Camera", truth, start, asked.size, asked.output)
    for name, scene in (("ours", ours.scene), ("plain AD", theirs.scene)):
        ahead = [np.diff(numbers(s, start).reshape(2, 3), axis=0).ravel() for s in (truth, scene)]
        sine = np.linalg.norm(np.cross(*ahead)) / np.prod(
            [np.linalg.norm(vector) for vector in ahead]
        )
        print(f"{name}: direction off by {np.degrees(np.arcsin(sine)):.1e} degrees")
