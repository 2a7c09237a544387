"""The position of a light, from its shadows and highlights."""

from common import SCENES, arguments, recover

import whitted as wt

if __name__ == "__main__":
    asked = arguments(__doc__)
    truth = wt.load_scene(SCENES / "cornell.toml")
    recover("Light", truth, {"lights.key.position": [-0.1, 0.6, 0.0]}, asked.size, asked.output)
