"""The index of refraction of a glass ball, from starts far below and far above it."""

from common import SCENES, arguments, recover

import whitted as wt

if __name__ == "__main__":
    asked = arguments(__doc__)
    truth = wt.load_scene(SCENES / "cornell.toml")
    for start in (1.2, 1.9):
        # The loss has local minima at wrong indices, hence several starts
        bounds = {"materials.glass.ior": (1.05, 2.2)}
        recover(
            f"Index of glass from {start}",
            truth,
            {"materials.glass.ior": start},
            asked.size,
            asked.output,
            bounds=bounds,
            starts=6,
        )
