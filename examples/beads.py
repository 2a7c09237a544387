"""Glass beads: the positions of 300 of them, recovered from one picture after a small push."""

import drjit as dr
import numpy as np
from common import arguments
from drjit.opt import Adam

import whitted as wt

COUNT, RADIUS, SPP = 300, 0.05, 4
NAME = "clouds.beads.center"


def scene_of(center: np.ndarray, size: int) -> wt.Scene:
    """Beads in front of a striped wall."""
    glass = wt.Material("glass", reflection=1, refraction=1, ior=1.5, fresnel=True, shadow=0.2)
    board = wt.Checkerboard(color=(0.2, 0.3, 0.7), size=0.25)
    wall = wt.Material("wall", color=(0.9, 0.8, 0.6), checker=board)
    return wt.Scene(
        wt.Camera(position=(0, 0, 4), look_at=(0, 0, 0), fov=32, resolution=(size, size)),
        clouds=[wt.Cloud("beads", center=center, radius=RADIUS, material=glass)],
        planes=[wt.Plane("wall", normal=(0, 0, 1), offset=0.6, material=wall)],
        lights=[wt.PointLight("lamp", position=(1, 2, 4), intensity=(1, 1, 1))],
        ambient=(0.1, 0.1, 0.1),
        max_depth=4,
    )


def places(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points in a slab, none close to another as the camera sees it."""
    found = np.empty((0, 3))
    while len(found) < count:
        point = rng.uniform((-1, -1, -0.2), (1, 1, 0.2))
        if (np.linalg.norm(found[:, :2] - point[:2], axis=1) > 1.8 * RADIUS).all():
            found = np.vstack([found, point])
    return found


def apart(scene: wt.Scene, center: np.ndarray) -> float:
    """The median distance of beads from their true places, across the view, in radii."""
    away = scene.numbers[NAME][:, :2] - center[:, :2]
    return float(np.median(np.linalg.norm(away, axis=1))) / RADIUS


if __name__ == "__main__":
    asked = arguments(__doc__, size=96)
    rng = np.random.default_rng(0)
    truth = places(COUNT, rng)
    target = wt.render(scene_of(truth, asked.size), SPP)
    start = scene_of(truth + rng.normal(0, 0.2 * RADIUS, truth.shape), asked.size)
    optimiser, scene = Adam(lr=0.004, params=start.parameters(NAME)), start
    for step in range(20):
        optimiser.set_learning_rate(0.004 * 0.85**step)
        scene = start.replace(optimiser)
        loss = dr.mean(dr.abs(wt.render(scene, SPP) - target), axis=None)
        dr.backward(loss)
        optimiser.step()
    print(f"median distance of {COUNT} beads from their true places, in radii:")
    print(f"at the start {apart(start, truth):.3f}, at the end {apart(scene, truth):.3f}")
    asked.output.mkdir(parents=True, exist_ok=True)
    wt.write_image(asked.output / "beads.png", wt.render(scene, 16))
