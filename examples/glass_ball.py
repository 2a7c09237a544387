"""The position and the radius of a glass ball, from a start that is half a radius away."""

from common import SCENES, arguments, recover

import whitted as wt

if __name__ == "__main__":
    asked = arguments(__doc__)
    truth = wt.load_scene(SCENES / "cornell.toml")
    start = {"spheres.ball.center": [0.28, -0.50, 0.54], "spheres.ball.radius": 0.32}
    recover("Glass ball", truth, start, asked.size, asked.output)
