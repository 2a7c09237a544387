"""Ten glass balls on two shelves: where all of them are, and their index, from one picture."""

import numpy as np
from common import arguments, recover

import whitted as wt

RADIUS, ROWS, COLUMNS = 0.35, (-0.55, 0.55), (-1.8, -0.9, 0.0, 0.9, 1.8)
# How far from the truth the balls start, in their radii, and the index
AWAY, INDEX = 0.2, 1.45


def shelf() -> wt.Scene:
    """The balls before a checkered wall; each stands a little off its place."""
    random = np.random.default_rng(7)
    glass = wt.Material(
        "glass", specular=0.5, shininess=300, reflection=1, refraction=1, fresnel=True, shadow=0.4
    )
    board = wt.Checkerboard(color=(0.15, 0.25, 0.4), size=0.6)
    wall = wt.Material("wall", color=(0.75, 0.7, 0.6), checker=board)
    places = [(x, y, 0) for y in ROWS for x in COLUMNS] + random.uniform(-0.08, 0.08, (10, 3))
    return wt.Scene(
        camera=wt.Camera(position=(0, 0, 6), look_at=(0, 0, 0), fov=32, resolution=(192, 192)),
        spheres=[
            wt.Sphere(f"ball{k}", center=place, radius=RADIUS, material=glass)
            for k, place in enumerate(places)
        ],
        planes=[wt.Plane("wall", normal=(0, 0, 1), offset=1.2, material=wall)],
        lights=[wt.PointLight("lamp", position=(1.5, 3, 5), intensity=(0.8, 0.8, 0.8))],
        ambient=(0.25, 0.25, 0.25),
        max_depth=6,
    )


if __name__ == "__main__":
    asked = arguments(__doc__)
    truth, random = shelf(), np.random.default_rng(8)
    start: dict = {"materials.glass.ior": INDEX}
    for name, value in truth.parameters("spheres.*.center").items():
        step = random.normal(size=3)
        away = AWAY * RADIUS * step / np.linalg.norm(step)
        start[name] = (value.numpy().ravel() + away).tolist()
    found, _ = recover("Shelf", truth, start, asked.size, asked.output, plain=False)
    print(found.quality)
