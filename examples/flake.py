"""A sphere-flake: mirror balls that carry smaller ones, up to 66,430 of them.

Source: the "balls" of E. Haines, "A Proposal for Standard Graphics Environments" (1987).
"""

from time import perf_counter

import numpy as np
from common import arguments

import whitted as wt

# Balls, and how many more each level has
LEVELS = 5


def flake(levels: int) -> np.ndarray:
    """The balls of a flake, as rows of center and radius.

    Each ball carries nine of a third of its radius: six around its equator and three above. A ball
    knows the direction in which it grew.
    """
    ring, upper = np.arange(6) * np.pi / 3, np.pi / 6 + np.arange(3) * 2 * np.pi / 3
    around = np.stack([np.cos(ring), np.zeros(6), np.sin(ring)], 1)
    above = np.stack(
        [np.cos(upper) / 3**0.5, np.full(3, (2 / 3) ** 0.5), np.sin(upper) / 3**0.5], 1
    )
    ways = np.concatenate([around, above])
    center, radius, up = np.zeros((1, 3)), 0.5, np.array([[0.0, 1.0, 0.0]])
    rows = [np.column_stack([center, [radius]])]
    for _ in range(levels):
        side = np.cross(up, [0.31, 0.2, 0.93])
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        frame = np.stack([side, up, np.cross(up, side)], 1)
        up = np.einsum("wk,nkj->nwj", ways, frame).reshape(-1, 3)
        center = np.repeat(center, len(ways), 0) + up * radius * 4 / 3
        radius /= 3
        rows.append(np.column_stack([center, np.full(len(center), radius)]))
    return np.concatenate(rows)


def scene_of(balls: np.ndarray, size: int) -> wt.Scene:
    mirror = wt.Material(
        "mirror", color=(0.4, 0.36, 0.2), specular=0.3, shininess=20, reflection=0.5
    )
    ground = wt.Material("ground", color=(0.6, 0.45, 0.2))
    return wt.Scene(
        wt.Camera(position=(2.1, 1.7, 1.3), look_at=(0, 0, 0), fov=45, resolution=(size, size)),
        clouds=[wt.Cloud("balls", spheres=balls, material=mirror)],
        planes=[wt.Plane("ground", normal=(0, 1, 0), offset=0.5, material=ground)],
        lights=[
            wt.PointLight("high", position=(4, 3, 2), intensity=(0.5, 0.5, 0.5)),
            wt.PointLight("back", position=(1, 4, -4), intensity=(0.5, 0.5, 0.5)),
        ],
        background=(0.08, 0.36, 0.75),
        ambient=(0.05, 0.05, 0.05),
        max_depth=4,
    )


if __name__ == "__main__":
    asked = arguments(__doc__)
    asked.output.mkdir(parents=True, exist_ok=True)
    for levels in range(LEVELS + 1):
        balls = flake(levels)
        scene = scene_of(balls, asked.size)
        start = perf_counter()
        wt.write_image(asked.output / f"flake{levels}.png", wt.render(scene, 16, boundary=False))
        print(f"{len(balls):6} balls: {perf_counter() - start:.2f} s")
