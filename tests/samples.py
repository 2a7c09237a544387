"""Scene files for tests, built of parts.

Every part is a function from numbers to a table of TOML, one line a key. A scene file is the sum of
its parts; keys of the whole scene come before the first table.
"""

from functools import partial
from pathlib import Path

import numpy as np

import whitted

# The shipped scenes
SHIPPED = sorted((Path(__file__).parents[1] / "scenes").glob("*.toml"))

# Spacing of the numbers just above 1: a rounding is up to half of it
EPSILON = {"single": 2.0**-23, "double": 2.0**-52}

# Samples without the edges between them, for tests of what a sample is
render_plain = partial(whitted.render, boundary=False)


def toml(value):
    """A value as TOML writes it; text is TOML already."""
    if isinstance(value, (bool, np.bool_)):
        return str(bool(value)).lower()
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(own)}" for key, own in value.items()) + " }"
    if isinstance(value, (list, tuple, np.ndarray)):
        return f"[{', '.join(map(toml, value))}]"
    return f"{value}"


def keys(**values):
    """A line for each key that has a value."""
    return "".join(f"{key} = {toml(own)}\n" for key, own in values.items() if own is not None)


def quoted(text):
    return None if text is None else f'"{text}"'


def sphere(center, radius, material, name=None):
    return "[[spheres]]\n" + keys(
        name=quoted(name), center=center, radius=radius, material=quoted(material)
    )


def plane(normal, offset, material, name=None):
    return "[[planes]]\n" + keys(
        name=quoted(name), normal=normal, offset=offset, material=quoted(material)
    )


def disc(center, normal, radius, material, name=None):
    return "[[discs]]\n" + keys(
        name=quoted(name), center=center, normal=normal, radius=radius, material=quoted(material)
    )


def material(name, **fields):
    return f"[materials.{name}]\n" + keys(**fields)


def light(position, intensity=(1, 1, 1), falloff=None, name=None):
    return "[[lights]]\n" + keys(
        name=quoted(name), position=position, intensity=intensity, falloff=quoted(falloff)
    )


def sun(direction, irradiance=(1, 1, 1), name=None):
    """A directional light."""
    return "[[lights]]\n" + keys(
        name=quoted(name), type='"directional"', direction=direction, irradiance=irradiance
    )


def camera(position, look_at=(0, 0, 0), fov=50, resolution=(16, 12), up=None):
    return "[camera]\n" + keys(
        position=position, look_at=look_at, up=up, fov=fov, resolution=resolution
    )


CAMERA = camera([0.1, 0.4, 3.2])
SKY = keys(background=[0.3, 0.5, 0.9], ambient=[0.2, 0.15, 0.1])
CHECKER = {"color": [0.1, 0.8, 0.7], "size": 0.37}
MATERIALS = "".join(
    [
        material("red", color=[0.8, 0.2, 0.1], specular=0.4, shininess=7.5),
        material("mirror", color=[0.05, 0.1, 0.1], specular=0.5, reflection=0.8),
        material(
            "glass",
            color=[0.02, 0.0, 0.05],
            specular=0.3,
            reflection=1.0,
            refraction=0.9,
            ior=1.5,
            fresnel=True,
        ),
        material("tinted", color=[0.1, 0.2, 0.1], reflection=0.3, refraction=0.6, ior=1.7),
        material("water", refraction=1.0, ior=1.33),
        material("air", reflection=1.0, refraction=1.0, ior=1.0, fresnel=True),
        material("coat", color=[0.3, 0.3, 0.6], reflection=0.7, fresnel=True),
        material("lacquer", color=[0.3, 0.1, 0.1], reflection=0.9, ior=1.9, fresnel=True),
        material("veil", color=[0.1, 0.3, 0.2], shadow=0.35),
        material("bright_glass", reflection=1.0, refraction=1.0, ior=1.4, fresnel=True, shadow=0.2),
        material("ghost", color=[0.5, 0.5, 0.4], shadow=0),
        material("pane", color=[0.1, 0.1, 0.1], reflection=0.4, refraction=0.5),
        material("coated_pane", reflection=1.0, refraction=0.8, fresnel=True),
        material("checks", color=[0.9, 0.1, 0.2], checker=CHECKER),
    ]
)
LIGHT = light([1.5, 2.4, 2.0], [0.9, 0.8, 0.7])
SUN = sun([-0.5, -1.2, -0.7], [0.8, 0.7, 0.9])
SECOND_LIGHT = light([-1.3, 1.9, 1.1], [1.5, 2.0, 2.5], "inverse-square")
FLOOR = plane([0, 2, 0], 0.8, "checks")


BALLS = [[-0.8, -0.2, 0.1], 0.55], [[0.7, -0.3, 0.5], 0.45], [[0.15, 0.5, -0.6], 0.6]


def three(*materials):
    """Three balls in a row, of these materials."""
    return "".join(sphere(*ball, material) for ball, material in zip(BALLS, materials, strict=True))


def scene(*parts, sky=SKY, camera=CAMERA):
    """A scene file; tables that come last in TOML come last here."""
    return sky + camera + MATERIALS + "".join(parts)


# A floor, a wall and two lights
ROOM = FLOOR + plane([0, 0, 1], 2.1, "red") + LIGHT + SECOND_LIGHT
SCENES = {
    "diffuse under two lights": scene(three("red", "red", "red"), ROOM),
    "mirrors": scene(three("mirror", "mirror", "red"), ROOM),
    "Fresnel glass": scene(three("glass", "glass", "red"), ROOM),
    "constant glass": scene(three("tinted", "red", "tinted"), ROOM),
    "one glass": scene(three("red", "mirror", "water"), ROOM),
    "all": scene(three("glass", "mirror", "tinted"), ROOM),
    "bubble in glass, ball in water": scene(
        sphere([-0.8, 0, 0], 0.7, "glass"),
        sphere([-0.7, 0.1, 0.1], 0.4, "air"),
        sphere([0.8, 0, 0], 0.7, "water"),
        sphere([0.7, -0.1, 0.2], 0.3, "red"),
        sphere([0.9, 0.2, 0.3], 0.25, "water"),
        ROOM,
        sky="max_depth = 7\n" + SKY,
    ),
    "overlapping glass": scene(
        sphere([-0.3, 0, 0], 0.75, "glass"),
        sphere([0.4, 0.1, 0.2], 0.6, "tinted"),
        sphere([0.1, 0.3, 0.5], 0.3, "air"),
        ROOM,
    ),
    "overlapping glass of equal radius": scene(
        sphere([-0.3, 0, 0], 0.6, "glass"),
        sphere([0.4, 0.1, 0.2], 0.6, "tinted"),
        sphere([0, 0.4, 0.1], 0.6, "water"),
        ROOM,
    ),
    "mirror in glass, glass through a floor": scene(
        sphere([-0.4, 0, 0], 0.7, "tinted"),
        sphere([-0.3, 0.1, 0.1], 0.3, "mirror"),
        sphere([0.7, -0.4, 0.3], 0.4, "water"),
        ROOM,
    ),
    "camera in two glasses": scene(
        sphere([0.2, 0.4, 3.0], 0.8, "water"),
        sphere([0.1, 0.3, 3.3], 0.3, "glass"),
        three("glass", "red", "mirror"),
        ROOM,
    ),
    "light in glass": scene(
        three("glass", "tinted", "red"),
        ROOM,
        light([-0.7, -0.1, 0.3], [1, 1, 2]),
    ),
    "checkers on all axes": scene(
        three("mirror", "red", "red"),
        FLOOR,
        plane([0, 0.1, 1], 1.5, "checks"),
        plane([-3, 0.2, 1], 3.4, "checks"),
        LIGHT,
    ),
    "panes": scene(
        three("red", "glass", "red"),
        plane([0.3, 0.1, 1], -0.6, "pane"),
        plane([0, 0.3, -1], 0.9, "coated_pane"),
        ROOM,
    ),
    "opaque Fresnel": scene(three("coat", "coat", "red"), ROOM),
    "opaque Fresnel among glass": scene(
        three("coat", "glass", "tinted"), sphere([0.6, -0.2, 0.6], 0.2, "coat"), ROOM
    ),
    "polished walls": scene(
        three("coat", "glass", "lacquer"), plane([0, 1, 0.1], 0.8, "lacquer"), LIGHT
    ),
    "polish without glass": scene(
        three("coat", "mirror", "lacquer"), plane([0, 1, 0], 0.8, "coat"), LIGHT
    ),
    "camera in glass before polish": scene(
        sphere([0.1, 0.3, 3.1], 0.5, "glass"),
        three("coat", "lacquer", "red"),
        plane([0, 1, 0], 0.8, "lacquer"),
        LIGHT,
    ),
    "partial shadows": scene(three("veil", "bright_glass", "red"), ROOM),
    "partial shadows on each other": scene(
        three("veil", "veil", "bright_glass"), sphere([0.1, 0.9, 0.4], 0.3, "veil"), ROOM
    ),
    "no shadow": scene(three("ghost", "red", "mirror"), ROOM),
    "discs": scene(
        three("red", "mirror", "glass"),
        disc([0.2, 0.1, 0.6], [0.4, -1, 0.3], 0.5, "red"),
        disc([-0.6, 0.5, -0.3], [1, 0.2, 2], 0.7, "mirror"),
        disc([0.7, 0.9, -0.4], [0, 1, 0.2], 0.6, "checks"),
        ROOM,
    ),
    "discs alone": scene(disc([0.2, 0.1, 0], [0.4, -1, 0.9], 0.8, "red"), LIGHT),
    "discs that let rays and light through": scene(
        three("red", "veil", "glass"),
        disc([0.1, 0.3, 0.9], [0.3, 0.1, 1], 0.9, "pane"),
        disc([0.5, 1.2, 0.9], [0.3, 1, 0.4], 0.6, "veil"),
        FLOOR,
        LIGHT,
    ),
    "sun": scene(
        three("glass", "mirror", "red"), disc([0.3, 1.1, 0.4], [0.2, 1, 0], 0.5, "red"), FLOOR, SUN
    ),
    "sun and lamp": scene(three("red", "veil", "tinted"), FLOOR, SUN, LIGHT),
    "least importance": scene(
        three("glass", "mirror", "tinted"), ROOM, sky="min_importance = 0.07\nmax_depth = 8\n" + SKY
    ),
    "depth 1": scene(three("glass", "mirror", "tinted"), ROOM, sky="max_depth = 1\n" + SKY),
    "depth 2": scene(three("glass", "mirror", "tinted"), ROOM, sky="max_depth = 2\n" + SKY),
    "depth 9": scene(three("glass", "mirror", "tinted"), ROOM, sky="max_depth = 9\n" + SKY),
    "black sky, no ambient": scene(three("red", "mirror", "glass"), ROOM, sky=""),
    "no light": scene(three("red", "mirror", "glass"), FLOOR),
    "tilted narrow camera": scene(
        three("red", "mirror", "glass"),
        ROOM,
        camera=camera([1, 2, 4], [0.1, 0, 0.2], fov=30, resolution=(12, 24), up=[0.5, 1, 0.2]),
    ),
}


def random_scene(seed):
    """Any number of spheres, planes, lights and materials of all kinds, in each other's way.

    Each seed is a structure, and kernels, of its own; `strategies.py` has scenes of few structures.
    """
    rng = np.random.default_rng(seed)

    def some(low, high, n=None):
        return np.round(rng.uniform(low, high, n), 3).tolist()

    def maybe(x):
        return x if rng.random() < 0.6 else 0.0

    def some_material(name, **more):
        fields = {"color": some(0, 1, 3), "shininess": some(1, 60), "ior": some(0.6, 2.2)}
        weights = {key: maybe(some(0, 1)) for key in ("specular", "reflection", "refraction")}
        return material(name, **fields, **weights, **more)

    fresnel = [rng.random() < 0.5 for _ in range(rng.integers(1, 6))]
    names = [f"m{i}" for i in range(len(fresnel))]
    falloffs = [rng.choice(["none", "inverse-square"]) for _ in range(rng.integers(0, 4))]
    return "".join(
        [
            keys(
                max_depth=rng.integers(1, 9),
                min_importance=maybe(some(0, 0.2)),
                background=some(0, 1, 3),
                ambient=some(0, 0.5, 3),
            ),
            camera(
                some(-1, 1, 3),
                some(2, 3, 3),
                up=some(-1, 1, 3),
                fov=some(20, 120),
                resolution=(12, 10),
            ),
            *(some_material(name, fresnel=own) for name, own in zip(names, fresnel, strict=True)),
            some_material("checks", checker={"color": some(0, 1, 3), "size": some(0.2, 1)}),
            *(
                sphere(some(-1, 3, 3), some(0.2, 1.6), rng.choice(names))
                for _ in range(rng.integers(0, 7))
            ),
            *(
                plane(some(-1, 1, 3), some(-0.5, 4), rng.choice([*names, "checks"]))
                for _ in range(rng.integers(0, 4))
            ),
            *(light(some(-2, 3, 3), some(0, 2, 3), falloff) for falloff in falloffs),
        ]
    )
