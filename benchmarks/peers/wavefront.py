"""The yardstick's scene for array libraries like NumPy, a generation of rays at a time.

`numpy_peer.py` and `jax_peer.py` share it. They differ in how they pack rays and add to pixels.
`xp` is the library; vectors are arrays of shape (3, rays).
"""

import math

import common
import numpy as np

SIZE, DEPTH, SPHERES = 512, 5, 3


class Tables:
    """What of the scene is no parameter."""

    def __init__(self) -> None:
        loaded = common.scene()
        materials = [
            loaded["materials"][shape["material"]]
            for shape in (*loaded["spheres"], *loaded["planes"])
        ]
        self.normals = np.array([plane["normal"] for plane in loaded["planes"]], np.float32)
        self.colors = np.array([m.get("color", [0, 0, 0]) for m in materials], np.float32)
        self.reflection, self.refraction = (
            np.array([m.get(field, 0) for m in materials], np.float32)
            for field in ("reflection", "refraction")
        )
        self.scale = math.tan(math.radians(loaded["camera"]["fov"] / 2))


def flat_parameters() -> np.ndarray:
    """The 24 numbers of the parameters."""
    return np.array(
        [number for values in common.values().values() for number in values], np.float32
    )


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def unit(xp, a):
    return a / xp.sqrt(dot(a, a))


def primary(xp, tables: Tables, parameters, places):
    """Origins and directions of the rays through these pixels' centres."""
    camera = parameters[21:24]
    forward = unit(xp, -camera)
    right = unit(xp, xp.stack([-forward[2], 0 * forward[0], forward[0]]))
    up = xp.stack(
        [
            -right[2] * forward[1],
            right[2] * forward[0] - right[0] * forward[2],
            right[0] * forward[1],
        ]
    )
    u = (2 * (places % SIZE + 0.5) / SIZE - 1) * tables.scale
    v = (1 - 2 * (places // SIZE + 0.5) / SIZE) * tables.scale
    d = unit(xp, forward[:, None] + right[:, None] * u + up[:, None] * v)
    return camera[:, None] + 0 * d, d.astype(np.float32)


def chord(xp, parameters, k: int, o, d):
    """What a sphere cuts out of a ray.

    Returns:
        The distance to the middle of the chord, half the chord's length, and whether there is one.
    """
    to = parameters[4 * k : 4 * k + 3, None] - o
    b = dot(to, d)
    miss = to - d * b
    disc = parameters[4 * k + 3] ** 2 - dot(miss, miss)
    return b, xp.sqrt(xp.where(disc > 0, disc, 1)), disc > 0


def closest(xp, tables: Tables, parameters, o, d, source, inward):
    """The distance to the nearest primitive, and its number.

    Args:
        source: the primitive that a ray starts on, or -1.
        inward: whether the ray goes into it.
    """
    t, index = xp.full(o.shape[1], np.inf, np.float32), xp.full(o.shape[1], -1, np.int32)
    for k in range(SPHERES):
        b, half, meets = chord(xp, parameters, k, o, d)
        on = source == k
        distance = xp.where(on | (b - half <= 0), b + half, b - half)
        nearer = meets & (~on | inward) & (distance > 0) & (distance < t)
        t, index = xp.where(nearer, distance, t), xp.where(nearer, k, index)
    for k, normal in enumerate(tables.normals, SPHERES):
        slope = dot(normal, d)
        distance = -(dot(normal, o) + 1) / xp.where(slope == 0, 1, slope)
        nearer = (slope != 0) & (source != k) & (distance > 0) & (distance < t)
        t, index = xp.where(nearer, distance, t), xp.where(nearer, k, index)
    return t, index


def occluded(xp, parameters, p, light, far, index, inside):
    """Whether a sphere keeps the light away. Planes do not: they bound a convex room around it."""
    blocked = xp.zeros(p.shape[1], bool)
    for k in range(SPHERES):
        b, half, meets = chord(xp, parameters, k, p, light)
        on = index == k
        distance = xp.where(on | (b - half <= 0), b + half, b - half)
        blocked |= meets & (~on | inside) & (distance > 0) & (distance < far)
    return blocked


def fiftieth(x):
    """x^50, by multiplications."""
    x2 = x * x
    x4 = x2 * x2
    x8 = x4 * x4
    x16 = x8 * x8
    return x16 * x16 * x16 * x2


def chosen(xp, index, numbers):
    """The number of a primitive, by a chain of choices, which is faster than a lookup."""
    found = xp.zeros(index.shape, np.float32)
    for k, number in enumerate(numbers):
        if number:
            found = xp.where(index == k, np.float32(number), found)
    return found


def shade(xp, tables: Tables, parameters, o, d, source, inward):
    """Shade a generation of rays.

    Returns:
        The light; of the reflected and of the refracted rays each direction, weight and whether
        they go into the primitive; the point that both start at, and the primitive it is on.
    """
    t, index = closest(xp, tables, parameters, o, d, source, inward)
    hits = index >= 0
    p = o + d * xp.where(hits, t, 1)
    n = xp.zeros_like(d)
    for k in range(SPHERES):
        n = xp.where(
            index == k, (p - parameters[4 * k : 4 * k + 3, None]) / parameters[4 * k + 3], n
        )
    for k, normal in enumerate(tables.normals, SPHERES):
        n = xp.where(index == k, normal[:, None], n)
    inside = dot(n, d) > 0
    n = xp.where(inside, -n, n)
    to = parameters[15:18, None] - p
    far = xp.sqrt(dot(to, to))
    light = to / far
    lambert, shine = dot(n, light), dot(n, unit(xp, light - d))
    lit = hits & (lambert > 0) & ~occluded(xp, parameters, p, light, far, index, inside)
    spot = np.float32(0.3) * fiftieth(xp.where(shine > 0, shine, 0))
    color = xp.stack([chosen(xp, index, column) for column in tables.colors.T])
    radiance = xp.where(lit, parameters[18:21, None] * (color * lambert + spot), 0)

    eta = xp.ones_like(t)
    for k in range(SPHERES):
        ior = parameters[12 + k]
        eta = xp.where(index == k, xp.where(inside, ior, 1 / ior), eta)
    cosine = -dot(d, n)
    squared = 1 - eta * eta * (1 - cosine * cosine)
    reflection, refraction = (
        chosen(xp, index, tables.reflection),
        chosen(xp, index, tables.refraction),
    )
    total = (refraction > 0) & (squared <= 0)
    reflection, refraction = (
        xp.where(total, reflection + refraction, reflection),
        xp.where(total, 0, refraction),
    )
    mirrored = d + 2 * cosine * n
    bent = eta * d + (eta * cosine - xp.sqrt(xp.where(refraction > 0, squared, 1))) * n
    return radiance, (mirrored, reflection, inside), (bent, refraction, ~inside), p, index
