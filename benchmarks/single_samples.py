"""Errors of derivatives at one sample a pixel, over random scenes that are full of edges.

usage: single_samples.py [SCENES]

Four balls of mirrors, glass and clay lie anywhere over a chequered floor, in pictures of 72 x 48
pixels. Each scene is differentiated by one number: a ball's place, or its radius. The reference has
16 samples a pixel. An error is a norm of a difference, over the norm of the reference; 1 is that of
an answer of 0.
"""

import sys

import numpy as np

import whitted as wt

MATERIALS = {
    "mirrors": ("chrome", "chrome", "gold", "clay"),
    "glass": ("glass", "glass", "clay", "chrome"),
    "mixed": ("glass", "clay", "gold", "clay"),
}
NAMES = ("spheres.ball0.center", "spheres.ball3.center", "spheres.ball1.radius")


def start(materials: tuple[str, ...]) -> wt.Scene:
    """A scene of four balls, to be moved."""
    known = [
        wt.Material("chrome", color=(0.05,) * 3, specular=0.5, shininess=60, reflection=0.8),
        wt.Material("glass", specular=0.3, reflection=1, refraction=1, fresnel=True),
        wt.Material("gold", color=(0.3, 0.2, 0.05), specular=0.3, reflection=0.6),
        wt.Material("clay", color=(0.7, 0.35, 0.25)),
    ]
    board = wt.Checkerboard(color=(0.2, 0.2, 0.25), size=0.5)
    floor = wt.Material("floor", color=(0.5,) * 3, reflection=0.3, checker=board)
    balls = [
        wt.Sphere(f"ball{k}", center=(k, 0, 0.1 * k), radius=0.4 + k / 20, material=material)
        for k, material in enumerate(materials)
    ]
    return wt.Scene(
        camera=wt.Camera(
            position=(0.1, 0.9, 4.2), look_at=(0, 0.1, 0), fov=38, resolution=(72, 48)
        ),
        spheres=balls,
        planes=[wt.Plane("floor", normal=(0, 1, 0), offset=0.5, material="floor")],
        lights=[wt.PointLight("key", position=(-1.5, 3, 2.5), intensity=(0.9,) * 3)],
        materials=[*known, floor],
        background=(0.2, 0.3, 0.5),
        max_depth=6,
    )


def errors(scene: wt.Scene, count: int) -> np.ndarray:
    """The errors of so many random scenes, in order of size."""
    random, found = np.random.default_rng(7), []
    for k in range(count):
        for ball in range(4):
            center = random.uniform((-1.1, -0.4, -0.8), (1.1, 0.7, 1.2))
            values = {"radius": random.uniform(0.15, 0.6), "center": center}
            scene = scene.replace({f"spheres.ball{ball}.{key}": own for key, own in values.items()})
        name = NAMES[k % 3]
        component = "x" if name.endswith("center") else None
        one, many = (
            wt.gradient(scene, name, component, spp).numpy().astype(float) for spp in (1, 16)
        )
        if np.linalg.norm(many) > 1e-3:
            found.append(np.linalg.norm(one - many) / np.linalg.norm(many))
    return np.sort(found)


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    for name, materials in MATERIALS.items():
        found = errors(start(materials), count)
        print(
            f"{name:8} {len(found)} scenes: median {np.median(found):.2f}, "
            f"9 of 10 below {np.quantile(found, 0.9):.2f}, largest {found[-1]:.2f}, "
            f"{np.count_nonzero(found > 1)} above 1",
            flush=True,
        )
