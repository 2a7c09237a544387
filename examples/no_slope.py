"""A fit that fails, as the loss has no slope towards the target, and what helps:
further tries, or several starts.
"""

from common import HERE, arguments, recover

import whitted as wt

if __name__ == "__main__":
    asked = arguments(__doc__)
    truth = wt.load_scene(HERE / "no_slope.toml")
    start = {"spheres.ball.center": [-1.2, -0.9, 0.0]}
    bounds = {"spheres.ball.center": (-2.0, 2.0)}
    # The ball and its target do not overlap, and do not where it moves a little
    recover(
        "No overlap, one start",
        truth,
        start,
        asked.size,
        asked.output,
        bounds=bounds,
        levels=1,
        plain=False,
        budget=None,
    )
    # In a coarse picture pixels are wide, but less wide than the gap
    recover(
        "No overlap, coarse to fine",
        truth,
        start,
        asked.size,
        asked.output,
        bounds=bounds,
        plain=False,
        budget=None,
    )
    # By default a fit tries further where it has not explained the picture
    found, _ = recover(
        "No overlap, further tries", truth, start, asked.size, asked.output, plain=False
    )
    print(found.quality)
    recover(
        "No overlap, several starts",
        truth,
        start,
        asked.size,
        asked.output,
        bounds=bounds,
        starts=24,
    )
