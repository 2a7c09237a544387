"""A start from nothing but the picture: three coloured balls on a floor, and a lamp.

Known are the camera over its floor, and how many balls there are. Where the balls are, how large,
of which colours, and where the lamp is, is read from the picture: first roughly, by looking for
patches of colour, then by a fit.
"""

import numpy as np
from common import arguments, recover

import whitted as wt

COUNT = 3
CAMERA = wt.Camera(position=(0, 1.2, 6), look_at=(0, 0.4, 0), fov=35, resolution=(192, 192))
# A pixel shows a colour, and not the grey floor, if its channels differ by this part of the largest
SATURATED = 0.35
# Where a lamp hangs before anything is known
LAMP = (0.5, 4.0, 3.0)


def scene_of(balls: list[tuple], lamp: tuple) -> wt.Scene:
    """A scene of balls (center, radius, colour) on a grey floor."""
    floor = wt.Material("floor", color=(0.6, 0.6, 0.6))
    spheres = [
        wt.Sphere(f"ball{k}", center=c, radius=r, material=wt.Material(f"paint{k}", color=color))
        for k, (c, r, color) in enumerate(balls)
    ]
    return wt.Scene(
        camera=CAMERA,
        spheres=spheres,
        planes=[wt.Plane("floor", normal=(0, 1, 0), offset=0, material=floor)],
        lights=[wt.PointLight("lamp", position=lamp, intensity=(0.8, 0.8, 0.8))],
        ambient=(0.2, 0.2, 0.2),
    )


def patches(mask: np.ndarray, count: int) -> list[np.ndarray]:
    """The largest connected patches of a mask, as pixels (row, column), from left to right."""
    label = np.where(mask, np.arange(mask.size).reshape(mask.shape) + 1, 0)
    while True:
        # Each pixel takes the largest label beside it
        wide = np.pad(label, 1)
        near = np.max([wide[:-2, 1:-1], wide[2:, 1:-1], wide[1:-1, :-2], wide[1:-1, 2:]], axis=0)
        grown = np.where(mask, np.maximum(label, near), 0)
        if (grown == label).all():
            break
        label = grown
    names, sizes = np.unique(label[label > 0], return_counts=True)
    largest = names[np.argsort(-sizes)[:count]]
    found = [np.argwhere(label == name) for name in largest]
    return sorted(found, key=lambda pixels: pixels[:, 1].mean())


def direction(row: float, column: float, size: int) -> np.ndarray:
    """The direction of the ray through a point of the square picture."""
    position, look_at = np.array(CAMERA.position), np.array(CAMERA.look_at)
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, (0, 1, 0))
    right /= np.linalg.norm(right)
    half = np.tan(np.radians(CAMERA.fov / 2))
    up = np.cross(right, forward)
    ray = forward + half * ((2 * column / size - 1) * right + (1 - 2 * row / size) * up)
    return ray / np.linalg.norm(ray)


def ball_of(pixels: np.ndarray, picture: np.ndarray) -> tuple:
    """A ball that stands on the floor and covers some pixels: center, radius and colour."""
    size = picture.shape[0]
    (top, left), (bottom, right) = pixels.min(0), pixels.max(0) + 1
    middle = direction((top + bottom) / 2, (left + right) / 2, size)
    sides = direction((top + bottom) / 2, left, size), direction((top + bottom) / 2, right, size)
    sine = np.sin(np.arccos(sides[0] @ sides[1]) / 2)
    # The center is a radius above the floor: height + distance * down = distance * sine
    distance = CAMERA.position[1] / (sine - middle[1])
    color = np.percentile(picture[pixels[:, 0], pixels[:, 1]], 75, axis=0)
    center = np.array(CAMERA.position) + distance * middle
    return center, distance * sine, np.clip(color, 0.02, 0.98)


if __name__ == "__main__":
    asked = arguments(__doc__)
    truth = scene_of(
        [
            ((-1.1, 0.5, -0.3), 0.5, (0.8, 0.2, 0.15)),
            ((0.1, 0.3, 0.9), 0.3, (0.2, 0.6, 0.25)),
            ((1.2, 0.62, -0.6), 0.62, (0.2, 0.3, 0.8)),
        ],
        (-2.0, 4.0, 3.5),
    )
    picture = wt.render(truth, 16, resolution=(asked.size, asked.size)).numpy()
    spread = picture.max(2) - picture.min(2)
    colored = patches(spread > SATURATED * np.maximum(picture.max(2), 1e-3), COUNT)
    guess = scene_of([ball_of(pixels, picture) for pixels in colored], LAMP)
    wanted = guess.parameters(
        "spheres.*.center", "spheres.*.radius", "materials.paint*.color", "lights.lamp.position"
    )
    start = {name: np.squeeze(value.numpy()).tolist() for name, value in wanted.items()}
    found, _ = recover("From nothing", truth, start, asked.size, asked.output, plain=False)
    print(found.quality)
