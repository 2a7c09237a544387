"""Where a camera was and where it looked, from a picture of a known scene.

A picture cannot tell how far away the point is that the camera looked at. The error bar says so.
What counts is the direction.
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
        lengths = [np.linalg.norm(vector) for vector in ahead]
        sine = np.linalg.norm(np.cross(*ahead)) / np.prod(lengths)
        print(f"{name}: direction off by {np.degrees(np.arcsin(sine)):.1e} degrees")
