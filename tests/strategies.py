"""What Hypothesis draws: scenes, similarities of space, and rays.

All numbers are made of whole numbers of steps, so that a failing example shrinks to few and simple
ones.
"""

import numpy as np
from hypothesis import strategies as st
from random_scenes import Similarity

# What a camera and the lights are near, with how often; a failing example shrinks to the first
PLACES = {"far": 10, "anywhere": 4, "in": 3, "on": 2, "center": 1}
# Rays in an example, a packet; a short list is filled up with its last ray
RAYS = 16
# How far what is on a sphere is off it in a generic scene, in units of the radius
BESIDE = 0.01


def whole(low, high):
    return st.integers(low, high)


@st.composite
def scenes(draw, layout, generic=True):
    """Anything legal: spheres in each other's way, of radii from 1e-3 to 1e3, and lights and the
    camera anywhere.

    Args:
        generic: nothing is on, along or across anything else, so that roundings decide nothing
            that can be seen. In other scenes a light may be exactly on a sphere, or a ray exactly
            along a plane.
    """
    # How far a number is off its step. That of a sphere always is: of two glasses of the same size
    # the first one fills what both contain, and two in the same place are a kernel of their own
    off = np.random.default_rng(0)

    def vector(extent, exact=not generic):
        steps = draw(st.tuples(*[whole(-100, 100)] * 3)) + off.uniform(-0.5, 0.5, 3) * (not exact)
        return steps * (extent / 100)

    def direction():
        v = vector(1.0)
        return v / np.linalg.norm(v) if v.any() else np.array([0.0, 0.0, 1.0])

    def part(low=0.0, high=1.0):
        return low + (high - low) * draw(whole(0, 1000)) / 1000

    def weight():
        """Zero in three of ten."""
        return max(0, draw(whole(-400, 1000))) / 1000

    def color(most=1.0):
        return np.array(draw(st.tuples(*[whole(0, 1000)] * 3))) * (most / 1000)

    extent = 10 ** (draw(whole(-20, 20)) / 10)
    wild = draw(whole(0, 9)) > 6
    centers = [vector(extent, exact=False) for _ in range(layout.spheres)]
    sizes = np.array([draw(whole(-300, 300) if wild else whole(-150, 0)) for _ in centers])
    sizes = sizes + off.uniform(-0.5, 0.5, len(centers))
    radii = np.clip(10 ** (sizes / 100) * (1 if wild else extent), 1e-3, 1e3)

    def place():
        """A point outside or anywhere, in a sphere, at its center, or on it."""
        kind = draw(st.sampled_from([kind for kind, often in PLACES.items() for _ in range(often)]))
        if kind in ("far", "anywhere") or not centers:
            return vector(extent * (4 if kind == "far" else 1))
        i = draw(whole(0, len(centers) - 1))
        beside = BESIDE * generic
        distance = {"in": part(0, 1 - beside), "center": 0.0, "on": 1 + beside}[kind]
        return centers[i] + direction() * (radii[i] * distance)

    numbers = {"background": color(), "ambient": color(0.5)}
    for i, (center, radius) in enumerate(zip(centers, radii, strict=True)):
        numbers |= {f"spheres.sphere{i}.center": center, f"spheres.sphere{i}.radius": radius}
    for i in range(layout.planes):
        offset = draw(whole(-100, 300)) / 100 + off.uniform(-0.005, 0.005)
        numbers |= {
            f"planes.plane{i}.normal": direction(),
            f"planes.plane{i}.offset": offset * extent,
        }
    for i in range(layout.spheres + layout.planes):
        index = draw(whole(-100, 1000))
        numbers |= {
            f"materials.m{i}.color": color(),
            f"materials.m{i}.specular": weight(),
            f"materials.m{i}.shininess": 10 ** part(0, 2.5),
            f"materials.m{i}.reflection": weight(),
            f"materials.m{i}.refraction": weight(),
            f"materials.m{i}.ior": 1.0 if index < 0 else 0.5 + index / 500,
        }
    for i in range(layout.lights):
        numbers |= {f"lights.light{i}.position": place(), f"lights.light{i}.intensity": color(2.0)}
    eye = place()
    return numbers | {
        "camera.position": eye,
        "camera.look_at": eye + direction() * extent,
        "camera.fov": part(10, 150),
    }


@st.composite
def similarities(draw, layout, rotation):
    """A shift, a scale and an order; the rotation is given, as a camera's `up` is compiled."""

    def places(kinds):
        """Things change places with others that are compiled alike."""
        result = list(range(len(kinds)))
        for kind in sorted(set(kinds)):
            alike = [i for i, other in enumerate(kinds) if other == kind]
            for i, new in zip(alike, draw(st.permutations(alike)), strict=True):
                result[i] = new
        return result

    spheres, planes = layout.materials[: layout.spheres], layout.materials[layout.spheres :]
    return Similarity(
        rotation,
        10 ** (draw(whole(-10, 10)) / 10),
        np.array(draw(st.tuples(*[whole(-200, 200)] * 3))) / 100,
        {
            "sphere": places(spheres),
            "plane": places(planes),
            "light": places([layout.falloff(i) for i in range(layout.lights)]),
        },
    )


@st.composite
def vectors(draw, units=False):
    """Up to 16 vectors within a cube of side 2, or unit vectors: (3, 16)."""
    vector = st.tuples(*[whole(-100, 100)] * 3)
    steps = draw(st.lists(vector, min_size=1, max_size=RAYS))
    result = np.array(steps + steps[-1:] * (RAYS - len(steps)), float).T / 100
    if units:
        result[2, ~result.any(0)] = 1
        result /= np.linalg.norm(result, axis=0)
    return result


def powers(low, high):
    """A power of ten: 1 is the simplest one."""
    return whole(100 * low, 100 * high).map(lambda steps: 10 ** (steps / 100))


def reals(low, high):
    """Up to 16 numbers: (16,)."""
    steps = st.lists(whole(0, 1000), min_size=1, max_size=RAYS)
    return steps.map(lambda k: low + (high - low) / 1000 * np.array(k + k[-1:] * (RAYS - len(k))))
