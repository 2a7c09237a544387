"""The position of a matte ball that the camera sees only in a mirror ball."""

from common import HERE, arguments, recover

import whitted as wt

if __name__ == "__main__":
    asked = arguments(__doc__)
    truth = wt.load_scene(HERE / "mirror_only.toml")
    recover(
        "Ball in a mirror",
        truth,
        {"spheres.hidden.center": [1.3, 0.7, 4.5]},
        asked.size,
        asked.output,
    )
