"""Hard cases of input: 30 and 31, scenes that make no sense, and fits that leave what does."""

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..core.arrays import Precision
from ..inverse.fit import FitResult, fit
from ..rendering.samples import render_samples
from ..scene.files import SceneError, load_scene
from ..scene.scene import Scene
from .case import Case, Check, count
from .scenes import GLASS, GLOW, SKY, WHITE, ball, camera, lamp, scene_of, wall

VIEW = camera((0, 0, 4), (0, 0, 0), 40, (12, 12))
GOOD = "".join(
    [
        GLOW,
        VIEW,
        WHITE,
        GLASS,
        ball("ball", (0, 0, 0), 0.8, "glass"),
        wall("floor", (0, 1, 0), 1, "white"),
        lamp((1, 3, 2)),
    ]
)
# What to write for what, and the place that the message is to name
BAD = (
    ("radius = 0.8", "radius = nan", "spheres[0].radius"),
    ("radius = 0.8", "radius = inf", "spheres[0].radius"),
    ("radius = 0.8", "radius = 0", "spheres[0].radius"),
    ("radius = 0.8", "radius = -1", "spheres[0].radius"),
    ("center = [0, 0, 0]", "center = [0, nan, 0]", "spheres[0].center"),
    ("ior = 1.5", "ior = 0", "materials.glass.ior"),
    ("ior = 1.5", "ior = -1.5", "materials.glass.ior"),
    ("normal = [0, 1, 0]", "normal = [0, 0, 0]", "planes[0].normal"),
    ("look_at = [0, 0, 0]", "look_at = [0, 0, 4]", "camera.look_at"),
    ("up = [0, 1, 0]", "up = [0, 0, 1]", "camera.up"),
    ("fov = 40", "fov = 0", "camera.fov"),
    ("fov = 40", "fov = 180", "camera.fov"),
    ("fov = 40", "fov = -3", "camera.fov"),
)


def refused(p: Precision) -> Iterator[Check]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        for old, new, place in BAD:
            path.write_text(GOOD.replace(old, new, 1))
            try:
                load_scene(path, p.name)
                told = "nothing"
            except SceneError as error:
                told = str(error)
            missing = sum(part not in told for part in (str(path), place))
            yield Check(f"{new}: of file and path not named", missing, 0)
        yield Check("files left behind", len(list(Path(folder).iterdir())) - 1, 0)


def _pushed(p: Precision) -> Iterator[tuple[str, Scene, list[str], Scene]]:
    """Fits that a picture pushes out of what is legal: what, the start, the names, and the scene of
    the picture.
    """
    shrinks = scene_of(p, GLOW, VIEW, WHITE, ball("ball", (0, 0, 0), 0.3, "white"))
    yield (
        "a radius through 0",
        shrinks,
        ["spheres.ball.radius"],
        shrinks.replace({"spheres.ball.center": [0, 0, 9]}),
    )
    glass = scene_of(
        p,
        SKY,
        VIEW,
        GLASS,
        WHITE,
        ball("ball", (0, 0, 0), 1, "glass"),
        ball("back", (0.2, 0, -3), 1, "white"),
    )
    thin = glass.replace({"materials.glass.ior": 1.02})
    yield (
        "an index through 1",
        thin,
        ["materials.glass.ior"],
        glass.replace({"materials.glass.ior": 0.8}),
    )
    lit = scene_of(p, VIEW, WHITE, ball("ball", (0, 0, 0), 0.5, "white"), lamp((0, 0, 1.5)))
    yield (
        "a sphere over the light",
        lit,
        ["spheres.ball.center"],
        lit.replace({"spheres.ball.center": [0, 0, 1.5]}),
    )
    near = scene_of(p, GLOW, VIEW, WHITE, ball("ball", (0, 0, 2.5), 0.5, "white"))
    yield (
        "a sphere over the camera",
        near,
        ["spheres.ball.center", "spheres.ball.radius"],
        near.replace({"spheres.ball.center": [0, 0, 4]}),
    )


def pushed(p: Precision) -> Iterator[Check]:
    for what, start, names, other in _pushed(p):
        target = render_samples(other, 4)
        for method in ("lm", "adam"):
            try:
                found = fit(start, target, wrt=names, method=method, spp=4, iterations=15)
                wrong = _wrong(found)
            except ValueError as error:
                # An error is as good, if it says which parameter and when
                wrong = float(not (names[0] in str(error) and "iteration" in str(error)))
            yield Check(f"{what}, {method}: numbers that are not finite or not legal", wrong, 0)
    # A loop of one's own, whose optimiser knows no bounds
    scene = scene_of(p, GLOW, VIEW, WHITE, GLASS, ball("ball", (0, 0, 0), 0.3, "glass"))
    for name, value in (
        ("spheres.ball.radius", 0),
        ("materials.glass.ior", -0.1),
        ("camera.fov", 180),
        ("spheres.ball.center", [0, math.nan, 0]),
    ):
        parameter = scene.parameters(name)
        parameter[name] = type(parameter[name])(value)
        try:
            scene.replace(parameter)
            told = "nothing"
        except ValueError as error:
            told = str(error)
        yield Check(f"{name} = {value}: not named", float(name not in told), 0)


def _wrong(found: FitResult) -> float:
    """How many numbers of a fit are not finite, or outside what is legal."""
    values = np.concatenate([step.x for step in found.history])
    losses = np.array([step.loss for step in found.history])
    low = {"radius": 0.0, "ior": 1.0}
    below = sum(
        float(np.min(value)) < low.get(name.rpartition(".")[2], -math.inf)
        for name, value in found.parameters.items()
    )
    return count(~np.isfinite(values)) + count(~np.isfinite(losses)) + below


CASES = (
    Case(
        30,
        "scenes that make no sense",
        "refused at load with file and path; nothing is written",
        "Exact.",
        refused,
    ),
    Case(
        31,
        "fits pushed out of bounds",
        "a bounded step, or an error that names parameter and iteration; never silent NaN",
        "Exact.",
        pushed,
    ),
)
