"""Random problems for fits: a scene, its picture, the numbers to find, and where to start.

Targets are plain samples, 64 a pixel, which share no code with the edges of the fit's own pictures.
A problem is kept if its picture tells the numbers: at the truth, noise of 1 % leaves each of them
known to 1 % of its size.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import whitted as wt
from whitted.inverse.bounds import shapes_of, start_of
from whitted.inverse.loss import Objective
from whitted.inverse.views import checked_view

ROOT = Path(__file__).parents[1]
FILES = sorted(
    [
        *ROOT.glob("scenes/*.toml"),
        *ROOT.glob("examples/*.toml"),
        ROOT / "benchmarks/mirrors.toml",
        ROOT / "benchmarks/yardstick.toml",
    ]
)
SIZE, SAMPLES = 128, 64
# Radiance; how far the start is, in sizes of the object, and how far for an index of refraction
NOISE = 0.0, 0.01, 0.05
DISTANCES = {"near": (0.25, 0.2), "far": (0.625, 0.5), "farther": (1.25, 1.0)}
# Numbers in a problem, at most
MOST = 9
# A number is recovered if it is off by this part of its size, or by so many of the deviations that
# no method can be better than
GOOD, DEVIATIONS = 0.01, 4.0


@dataclass(frozen=True)
class Problem:
    """What a fit is given, and what it should find."""

    file: str
    truth: wt.Scene
    start: wt.Scene
    target: np.ndarray
    names: list[str]
    noise: float
    allowed: np.ndarray  # how far off each number may be

    def errors(self, scene: wt.Scene) -> np.ndarray:
        """How far off the numbers of a scene are, in units of what is allowed."""
        off = numbers(scene, self.names) - numbers(self.truth, self.names)
        return np.abs(off) / self.allowed

    def true_loss(self) -> float:
        """The loss of the truth, as that of a fit."""
        return float(np.mean((wt.render(self.truth, 4).numpy() - self.target) ** 2)) / 2

    def solved(self, scene: wt.Scene) -> bool:
        return bool((self.errors(scene) <= 1).all())


def numbers(scene: wt.Scene, names: list[str]) -> np.ndarray:
    """The numbers of some parameters, in their order."""
    return np.concatenate([start_of(scene, name) for name in names])


def problem(number: int, distance: str, size: int = SIZE) -> Problem:
    """The problem of a number, drawn until its picture tells what is asked for.

    At every distance it has the same numbers to find.
    """
    random = np.random.default_rng(number)
    noise = NOISE[number % len(NOISE)]
    while True:
        file = FILES[random.integers(len(FILES))]
        truth = wt.load_scene(file).replace({"camera.resolution": (size, size)})
        names = _asked(truth, random)
        sizes = np.concatenate([_size(truth, name) for name in names])
        sigma = _least_deviations(truth, names)
        if (0.01 * sigma <= GOOD * sizes).all():
            break
    far, index = DISTANCES[distance]
    start = truth.replace(
        {
            name: _away(truth, name, index if name.endswith(".ior") else far, random)
            for name in names
        }
    )
    target = wt.render(truth, SAMPLES, boundary=False).numpy()
    target = target + random.normal(scale=noise, size=target.shape) if noise else target
    allowed = np.maximum(GOOD * sizes, DEVIATIONS * noise * sigma)
    return Problem(file.stem, truth, start, target, names, noise, allowed)


def _asked(scene: wt.Scene, random: np.random.Generator) -> list[str]:
    """Names of one to five parameters, with nine numbers at most."""
    glass = {
        name.split(".")[1]
        for name, value in scene.parameters("materials.*.refraction").items()
        if value.numpy()[0] > 0
    }
    names = [
        name
        for name in scene.parameters()
        if name.endswith((".center", ".radius", ".offset"))
        or name == "camera.position"
        or (name.startswith("lights.") and name.endswith(".position"))
        or (name.endswith(".ior") and name.split(".")[1] in glass)
    ]
    chosen, total = [], 0
    for k in random.permutation(len(names))[: random.integers(1, 6)]:
        size = start_of(scene, names[k]).size
        if total + size <= MOST:
            chosen.append(names[k])
            total += size
    return chosen


def _size(scene: wt.Scene, name: str) -> np.ndarray:
    """What an error of each number of a parameter is held against.

    The radius of the same shape; for lights, cameras and planes that of a typical sphere; 1 for an
    index of refraction.
    """
    count = start_of(scene, name).size
    if name.endswith(".ior"):
        return np.ones(count)
    own = f"{name.rpartition('.')[0]}.radius"
    radii = [start_of(scene, radius)[0] for radius in scene.parameters("spheres.*.radius")]
    radius = start_of(scene, own)[0] if name.startswith(("spheres.", "discs.")) else None
    return np.full(count, radius or np.median(radii))


def _away(scene: wt.Scene, name: str, far: float, random: np.random.Generator) -> list[float]:
    """The numbers of a parameter, moved in a random direction by `far` sizes."""
    true = start_of(scene, name)
    if name.endswith(".radius"):
        return [float(true[0] * (1 + far) ** random.choice([-1, 1]))]
    direction = random.normal(size=true.size)
    moved = true + far * _size(scene, name) * direction / np.linalg.norm(direction)
    if name.endswith(".ior"):
        # Below 1 an index is not looked for
        moved = np.where(moved < 1.02, 2 * true - moved, moved)
    return moved.tolist()


def _least_deviations(scene: wt.Scene, names: list[str]) -> np.ndarray:
    """The deviation of each number for noise of 1 (Cramér and Rao's bound)."""
    width, height = scene.resolution
    view = checked_view(scene, np.zeros((height, width, 3)), None, None)
    options = {"spp": 4, "boundary": True, "max_depth": None}
    objective = Objective((view,), tuple(names), shapes_of(scene, names), options, False)
    _, _, curvature = objective.normal_equations(numbers(scene, names))
    diagonal = curvature.diagonal()
    if not (diagonal > 0).all():
        return np.full(len(diagonal), np.inf)
    unit = 1 / np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(curvature * np.outer(unit, unit))
    if values[0] < 1e-6:
        return np.full(len(diagonal), np.inf)
    inverse = (vectors / values) @ vectors.T
    return np.sqrt(inverse.diagonal() / objective.total) * unit
