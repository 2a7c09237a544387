"""What examples share: arguments, and a fit with our gradients beside one with plain AD.

Plain AD (automatic differentiation) is that of samples alone, without what moving edges add.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np

import whitted as wt

HERE = Path(__file__).parent
SCENES = HERE.parent / "scenes"


def arguments(description: str, size: int = 192) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "--size", type=int, default=size, help="pixels along a side of the square pictures"
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("out"), help="folder for pictures"
    )
    return parser.parse_args()


def recover(
    title: str,
    truth: wt.Scene,
    start: dict,
    size: int,
    folder: Path,
    target=None,
    plain: bool = True,
    **options,
):
    """Fit a scene's parameters, print what was found, and write pictures.

    The table has the true numbers, those at the start, ours with one standard deviation, and those
    of plain AD. The latter may take as many iterations at each resolution as ours, but it makes no
    further tries.

    Args:
        title: of the table; the pictures are named after it.
        start: the parameters to recover, with the numbers that the fit starts from.
        target: the picture to match, if it is not one of `truth`.
        plain: whether to fit with plain AD as well.
        options: of `whitted.fit`.

    Returns:
        Our result, and that of plain AD or None.
    """
    folder.mkdir(parents=True, exist_ok=True)
    resolution = (size, size)
    target = wt.render(truth, 16, resolution=resolution) if target is None else target
    scene = truth.replace(start)
    ours = wt.fit(scene, target, wrt=list(start), resolution=resolution, **options)
    theirs = None
    if plain:
        with warnings.catch_warnings():
            # It warns where it sees no dependence; the table shows that
            warnings.simplefilter("ignore")
            once = {**options, "budget": None}
            theirs = wt.fit(
                scene, target, wrt=list(start), resolution=resolution, boundary=False, **once
            )
    print(f"\n{title}\n{'':28}{'true':>11}{'start':>11}{'found':>12}{'+-':>10}{'plain AD':>12}")
    true = numbers(truth, start)
    began = np.concatenate([np.ravel(value) for value in start.values()])
    other = numbers(theirs.scene, start) if theirs else np.full(len(true), np.nan)
    for (label, value, deviation), a, b, c in zip(ours.numbers(), true, began, other, strict=True):
        print(f"{label:28}{a:11.5f}{b:11.5f}{value:12.6f}{deviation:10.1e}{c:12.6f}")
    print(f"{ours.iterations} iterations, {ours.stopped}")
    name = title.replace(" ", "-").lower()
    wt.write_image(folder / f"{name}-target.png", target)
    wt.write_image(folder / f"{name}-start.png", wt.render(scene, 4, resolution=resolution))
    wt.write_image(folder / f"{name}-found.png", wt.render(ours.scene, 4, resolution=resolution))
    return ours, theirs


def numbers(scene: wt.Scene, names) -> np.ndarray:
    """The numbers of some parameters, in their order."""
    return np.concatenate([value.numpy().ravel() for value in scene.parameters(*names).values()])
