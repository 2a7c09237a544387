"""The position of a ball that is outside of the picture, from its shadow."""

from common import HERE, arguments, recover

import whitted as wt

if __name__ == "__main__":
    asked = arguments(__doc__)
    truth = wt.load_scene(HERE / "shadow_only.toml")
    recover(
        "Ball by its shadow",
        truth,
        {"spheres.ball.center": [0.1, 2.8, -0.4]},
        asked.size,
        asked.output,
    )
