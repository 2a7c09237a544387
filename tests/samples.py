"""Scene files for tests, built of parts."""

from functools import partial

import numpy as np

import whitted

# Samples without the edges between them, for tests of what a sample is
render_plain = partial(whitted.render, boundary=False)

CAMERA = (
    "[camera]\nposition = [0.1, 0.4, 3.2]\nlook_at = [0, 0, 0]\nfov = 50\nresolution = [16, 12]\n"
)
SKY = "background = [0.3, 0.5, 0.9]\nambient = [0.2, 0.15, 0.1]\n"
MATERIALS = """
[materials.red]
color = [0.8, 0.2, 0.1]
specular = 0.4
shininess = 7.5
[materials.mirror]
color = [0.05, 0.1, 0.1]
specular = 0.5
reflection = 0.8
[materials.glass]
color = [0.02, 0.0, 0.05]
specular = 0.3
reflection = 1.0
refraction = 0.9
ior = 1.5
fresnel = true
[materials.tinted]
color = [0.1, 0.2, 0.1]
reflection = 0.3
refraction = 0.6
ior = 1.7
[materials.water]
refraction = 1.0
ior = 1.33
[materials.air]
reflection = 1.0
refraction = 1.0
ior = 1.0
fresnel = true
[materials.coat]
color = [0.3, 0.3, 0.6]
reflection = 0.7
fresnel = true
[materials.lacquer]
color = [0.3, 0.1, 0.1]
reflection = 0.9
ior = 1.9
fresnel = true
[materials.veil]
color = [0.1, 0.3, 0.2]
shadow = 0.35
[materials.bright_glass]
reflection = 1.0
refraction = 1.0
ior = 1.4
fresnel = true
shadow = 0.2
[materials.ghost]
color = [0.5, 0.5, 0.4]
shadow = 0
[materials.pane]
color = [0.1, 0.1, 0.1]
reflection = 0.4
refraction = 0.5
[materials.coated_pane]
reflection = 1.0
refraction = 0.8
fresnel = true
[materials.checks]
color = [0.9, 0.1, 0.2]
checker = { color = [0.1, 0.8, 0.7], size = 0.37 }
"""
LIGHT = "[[lights]]\nposition = [1.5, 2.4, 2.0]\nintensity = [0.9, 0.8, 0.7]\n"
SUN = '[[lights]]\ntype = "directional"\ndirection = [-0.5, -1.2, -0.7]\nirradiance = [0.8, 0.7, 0.9]\n'
SECOND_LIGHT = '[[lights]]\nposition = [-1.3, 1.9, 1.1]\nintensity = [1.5, 2.0, 2.5]\nfalloff = "inverse-square"\n'
FLOOR = '[[planes]]\nnormal = [0, 2, 0]\noffset = 0.8\nmaterial = "checks"\n'


def sphere(center, radius, material):
    return f'[[spheres]]\ncenter = {center}\nradius = {radius}\nmaterial = "{material}"\n'


def disc(center, normal, radius, material):
    return f'[[discs]]\ncenter = {center}\nnormal = {normal}\nradius = {radius}\nmaterial = "{material}"\n'


def plane(normal, offset, material):
    return f'[[planes]]\nnormal = {normal}\noffset = {offset}\nmaterial = "{material}"\n'


BALLS = [[-0.8, -0.2, 0.1], 0.55], [[0.7, -0.3, 0.5], 0.45], [[0.15, 0.5, -0.6], 0.6]


def three(*materials):
    return "".join(sphere(*ball, material) for ball, material in zip(BALLS, materials, strict=True))


def scene(*parts, sky=SKY, camera=CAMERA):
    """A scene file; tables that come last in TOML come last here."""
    return sky + camera + MATERIALS + "".join(parts)


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
        "[[lights]]\nposition = [-0.7, -0.1, 0.3]\nintensity = [1, 1, 2]\n",
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
        camera="[camera]\nposition = [1, 2, 4]\nlook_at = [0.1, 0, 0.2]\nup = [0.5, 1, 0.2]\nfov = 30\nresolution = [12, 24]\n",
    ),
}


def random_scene(seed):
    """Any number of spheres, planes, lights and materials of all kinds, in each other's way."""
    rng = np.random.default_rng(seed)

    def some(low, high, n=None):
        return np.round(rng.uniform(low, high, n), 3).tolist()

    def maybe(x):
        return x if rng.random() < 0.6 else 0.0

    def material(name, *more):
        head = [
            f"[materials.{name}]",
            f"color = {some(0, 1, 3)}",
            f"shininess = {some(1, 60)}",
            f"ior = {some(0.6, 2.2)}",
        ]
        weights = [
            f"{key} = {maybe(some(0, 1))}" for key in ("specular", "reflection", "refraction")
        ]
        return "\n".join([*head, *weights, *more]) + "\n"

    fresnel = [
        f"fresnel = {str(bool(rng.random() < 0.5)).lower()}" for _ in range(rng.integers(1, 6))
    ]
    names = [f"m{i}" for i in range(len(fresnel))]
    falloffs = [
        f'falloff = "{rng.choice(["none", "inverse-square"])}"' for _ in range(rng.integers(0, 4))
    ]
    return "\n".join(
        [
            f"max_depth = {rng.integers(1, 9)}",
            f"min_importance = {maybe(some(0, 0.2))}",
            f"background = {some(0, 1, 3)}",
            f"ambient = {some(0, 0.5, 3)}",
            f"[camera]\nposition = {some(-1, 1, 3)}\nlook_at = {some(2, 3, 3)}\nup = {some(-1, 1, 3)}",
            f"fov = {some(20, 120)}\nresolution = [12, 10]",
            *(material(name, kind) for name, kind in zip(names, fresnel, strict=True)),
            material("checks", f"checker = {{ color = {some(0, 1, 3)}, size = {some(0.2, 1)} }}"),
            *(
                sphere(some(-1, 3, 3), some(0.2, 1.6), rng.choice(names))
                for _ in range(rng.integers(0, 7))
            ),
            *(
                plane(some(-1, 1, 3), some(-0.5, 4), rng.choice([*names, "checks"]))
                for _ in range(rng.integers(0, 4))
            ),
            *(
                f"[[lights]]\nposition = {some(-2, 3, 3)}\nintensity = {some(0, 2, 3)}\n{kind}"
                for kind in falloffs
            ),
        ]
    )
