"""Hard cases of input: 30, scene files without a meaning, and 31, fits pushed out of bounds."""

import math
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..core.arrays import Precision
from ..inverse.fit import fit
from ..inverse.result import FitResult
from ..rendering.samples import render_samples
from ..scene.files import SceneError, load_scene
from ..scene.scene import Scene
from .arrays import count
from .case import Case, Check
from .scenes import GLASS, WHITE, WHITE_AMBIENT, WHITE_SKY, ball, camera, lamp, scene_of, wall

VIEW = camera((0, 0, 4), (0, 0, 0), 40, (12, 12))
RADIUS, CENTER, INDEX = "spheres.ball.radius", "spheres.ball.center", "materials.glass.ior"

# 30: scenes that make no sense

VALID = "".join(
    [
        WHITE_AMBIENT,
        VIEW,
        WHITE,
        GLASS,
        ball("ball", (0, 0, 0), 0.8, "glass"),
        wall("floor", (0, 1, 0), 1, "white"),
        lamp((1, 3, 2)),
    ]
)
# A part of the valid scene, what replaces it, and the place that the message must name
INVALID = (
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
        for old, new, place in INVALID:
            path.write_text(VALID.replace(old, new, 1))
            try:
                load_scene(path, p.name)
                message = ""
            except SceneError as error:
                message = str(error)
            missing = sum(part not in message for part in (str(path), place))
            yield Check(f"{new}: file and place that the message lacks", missing, 0)
        yield Check("files left behind", len(list(Path(folder).iterdir())) - 1, 0)


# 31: fits pushed out of bounds


def pushed(p: Precision) -> Iterator[Check]:
    for what, start, names, other in _pushing_fits(p):
        target = render_samples(other, 4)
        for method in ("lm", "adam"):
            try:
                found = fit(
                    start, target, wrt=names, method=method, spp=4, iterations=15, budget=None
                )
                wrong = _illegal_numbers(found)
            except ValueError as error:
                # An error is as good, if it names the parameter and the iteration
                wrong = float(not (names[0] in str(error) and "iteration" in str(error)))
            yield Check(f"{what}, {method}: numbers that are not finite or not legal", wrong, 0)
    yield from _illegal_replacements(p)


def _pushing_fits(p: Precision) -> Iterator[tuple[str, Scene, list[str], Scene]]:
    """Fits whose target pushes a parameter out of its legal range.

    Yields:
        The name of the fit, its start, the parameters to recover, and the scene of the target.
    """
    shrinking = scene_of(p, WHITE_AMBIENT, VIEW, WHITE, ball("ball", (0, 0, 0), 0.3, "white"))
    unseen = shrinking.replace({CENTER: [0, 0, 9]})
    yield "a radius through 0", shrinking, [RADIUS], unseen
    sphere, back = ball("ball", (0, 0, 0), 1, "glass"), ball("back", (0.2, 0, -3), 1, "white")
    glass = scene_of(p, WHITE_SKY, VIEW, GLASS, WHITE, sphere, back)
    thin, thinner = glass.replace({INDEX: 1.02}), glass.replace({INDEX: 0.8})
    yield "an index through 1", thin, [INDEX], thinner
    lit = scene_of(p, VIEW, WHITE, ball("ball", (0, 0, 0), 0.5, "white"), lamp((0, 0, 1.5)))
    yield "a sphere over the light", lit, [CENTER], lit.replace({CENTER: [0, 0, 1.5]})
    near = scene_of(p, WHITE_AMBIENT, VIEW, WHITE, ball("ball", (0, 0, 2.5), 0.5, "white"))
    around_camera = near.replace({CENTER: [0, 0, 4]})
    yield "a sphere over the camera", near, [CENTER, RADIUS], around_camera


def _illegal_numbers(found: FitResult) -> float:
    """How many numbers of a fit are not finite or outside their legal range."""
    values = np.concatenate([step.x for step in found.history])
    losses = np.array([step.loss for step in found.history])
    least = {"radius": 0.0, "ior": 1.0}
    below = sum(
        float(np.min(value)) < least.get(name.rpartition(".")[2], -math.inf)
        for name, value in found.parameters.items()
    )
    return count(~np.isfinite(values)) + count(~np.isfinite(losses)) + below


def _illegal_replacements(p: Precision) -> Iterator[Check]:
    """What `Scene.replace` says to an optimiser that knows no bounds."""
    scene = scene_of(p, WHITE_AMBIENT, VIEW, WHITE, GLASS, ball("ball", (0, 0, 0), 0.3, "glass"))
    for name, value in (
        (RADIUS, 0),
        (INDEX, -0.1),
        ("camera.fov", 180),
        (CENTER, [0, math.nan, 0]),
    ):
        parameters = scene.parameters(name)
        parameters[name] = type(parameters[name])(value)
        try:
            scene.replace(parameters)
            message = ""
        except ValueError as error:
            message = str(error)
        yield Check(f"{name} = {value}: not named by the message", float(name not in message), 0)


CASES = (
    Case(
        30,
        "scenes that make no sense",
        "refused by a message that names file and place; nothing is written",
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
