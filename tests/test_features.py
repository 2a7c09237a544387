"""What a scene's kernels have compiled in follows from the numbers that the scene has now, however
they came there: from a file, by `Scene.replace`, or by `dataclasses.replace`.
"""

import dataclasses
import re

import numpy as np
import pytest
from drjit.llvm import ad
from samples import LIGHT, camera, keys, material, plane, scene, sphere, three
from samples import render_plain as render

import whitted as wt

RED = material("red", color=[0.8, 0.2, 0.1], specular=0.4)
BLUE = material("blue", color=[0.1, 0.2, 0.8])
AHEAD = camera([0, 0, 4], resolution=(24, 18))
SKY = keys(background=[0.3, 0.5, 0.9], ambient=[0.2, 0.15, 0.1])


def pair(center, radius):
    """A red ball, and a blue one somewhere."""
    balls = sphere([0.1, 0.2, 0], 0.7, "red") + sphere(center, radius, "blue")
    return SKY + AHEAD + RED + BLUE + balls + LIGHT


def picture(scene):
    return render(scene).numpy()


def test_ambient_light_that_was_black_is_not_ignored(load, precision):
    """Ambient light of 0 is left out of kernels; a scene made with another one has it in its own.

    Were what is left out stored when the file is read, the picture would stay dark.
    """
    dark, lit = (
        load(scene(three("red", "mirror", "glass"), LIGHT, sky=sky), precision)
        for sky in ("", keys(ambient=[0.5, 0.25, 1]))
    )
    changed = dataclasses.replace(dark, ambient=lit.ambient)
    np.testing.assert_array_equal(picture(changed), picture(lit))
    assert np.any(picture(changed) != picture(dark))


def test_spheres_moved_together_are_the_first_alone(load, precision):
    """Two spheres with the same numbers are one object. Moved apart again, they are two."""
    apart = load(pair([0.6, -0.3, 0.5], 0.4), precision)
    there = {"spheres.sphere1.center": [0.1, 0.2, 0], "spheres.sphere1.radius": 0.7}
    back = {"spheres.sphere1.center": [0.6, -0.3, 0.5], "spheres.sphere1.radius": 0.4}
    together = apart.replace(there)
    alone = load(SKY + AHEAD + RED + sphere([0.1, 0.2, 0], 0.7, "red") + LIGHT, precision)
    in_file = load(pair([0.1, 0.2, 0], 0.7), precision)
    np.testing.assert_array_equal(picture(together), picture(alone))
    np.testing.assert_array_equal(picture(together), picture(in_file))
    np.testing.assert_array_equal(picture(together.replace(back)), picture(apart))
    assert np.any(picture(together) != picture(apart))


def test_planes_are_the_same_from_either_side(load):
    """n . p + offset = 0 is also -n . p - offset = 0, of any length of n."""
    walls = plane([0, 0, 1], 1, "red") + plane([0.2, 0, 1], 3, "blue")
    apart = load(SKY + AHEAD + RED + BLUE + walls + LIGHT)
    together = apart.replace({"planes.plane1.normal": [0, 0, -2], "planes.plane1.offset": -1})
    alone = load(SKY + AHEAD + RED + plane([0, 0, 1], 1, "red") + LIGHT)
    np.testing.assert_array_equal(picture(together), picture(alone))


def ground(height):
    """A camera at some height above a sphere so large that single precision's squares cancel."""
    ahead = camera([0, height, 4], [0, 0, 0], resolution=(24, 18))
    return SKY + ahead + RED + sphere([0, -1e4, 0], 1e4, "red") + LIGHT


def test_ground_becomes_compensated_when_the_camera_comes_near(load):
    """From 1000 units above, the ground needs no compensated sums; from half a unit it does. The
    picture is that of a file with those numbers, to the last bit.
    """
    far, near = (load(ground(height), "single") for height in (1e3, 0.5))
    landed = far.replace({"camera.position": [0, 0.5, 4]})
    assert [bool(x.features.places.compensated) for x in (far, near, landed)] == [False, True, True]
    np.testing.assert_array_equal(picture(landed), picture(near))
    again = landed.replace({"camera.position": [0, 1e3, 4]})
    np.testing.assert_array_equal(picture(again), picture(far))
    assert not load(ground(0.5), "double").features.places.compensated


# What `Scene.replace` refuses

NUMBERS = {
    "camera": {"position": [0, 0, 4], "look_at": [0, 0, 0], "fov": 50, "resolution": [24, 18]},
    "materials.x": {"color": [0.5, 0.5, 0.5], "specular": 0.2, "refraction": 0.5},
    "spheres.sphere0": {"center": [0, 0, 0], "radius": 1},
    "planes.plane0": {"normal": [0, 1, 0], "offset": 2},
}


def text(name=None, value=None):
    """A scene file in which one parameter may have another value."""

    def of(thing):
        changed = name is not None and name.rpartition(".")[0] == thing
        return NUMBERS[thing] | ({name.rpartition(".")[2]: value} if changed else {})

    return (
        camera(**of("camera"))
        + material("x", fresnel=True, **of("materials.x"))
        + sphere(**of("spheres.sphere0"), material="x")
        + plane(**of("planes.plane0"), material="x")
        + LIGHT
    )


REFUSED = {
    "materials.x.reflection": (5, "expected a number in [0, 1]"),
    "materials.x.refraction": (-0.02, "expected a number in [0, 1]"),
    "materials.x.shadow": (1.02, "expected a number in [0, 1]"),
    "materials.x.color": ([0.5, 1.5, 0.5], "expected three numbers in [0, 1]"),
    "materials.x.specular": (-0.02, "expected a number >= 0"),
    "materials.x.shininess": (0, "expected a number > 0"),
    "materials.x.ior": (-0.005, "expected a number > 0"),
    "spheres.sphere0.radius": (-0.005, "expected a number > 0"),
    "spheres.sphere0.center": ([0, 1e40, 0], "expected three finite numbers, of at most 1e+18"),
    "spheres.sphere0.radius ": (1e-30, "expected a number > 0, of at least 1e-18"),
    "planes.plane0.normal": ([0, 0, 0], "expected a direction, not zero"),
    "camera.fov": (180, "expected an angle in degrees, in (0, 180)"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_replace_refuses_what_files_refuse_in_the_same_words(load, name):
    value, expected = REFUSED[name]
    name = name.strip()
    with pytest.raises(wt.SceneError) as of_file:
        load(text(name, value))
    assert str(of_file.value).endswith(f": {expected}")
    with pytest.raises(ValueError, match=f"^{re.escape(name)} = .*: {re.escape(expected)}(; |$)"):
        load(text()).replace({name: value})


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (
            {"camera.look_at": [0, 0, 4]},
            "camera.look_at = 0, 0, 4: expected a point other than camera.position",
        ),
        (
            {"camera.position": [0, 9, 0]},
            "camera.up = 0, 1, 0: expected a direction not parallel to the view",
        ),
    ],
)
def test_replace_refuses_a_camera_that_looks_nowhere(load, values, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        load(text()).replace(values)


def test_replace_tells_what_to_do(load):
    with pytest.raises(
        ValueError,
        match=r"^materials\.x\.reflection = 5: expected a number in \[0, 1\]; "
        r"bound the steps of the optimiser$",
    ):
        load(text()).replace({"materials.x.reflection": ad.Float(5)})
    # Where there is no optimiser, none is named
    with pytest.raises(ValueError, match=r"reflection = 5: expected a number in \[0, 1\]$"):
        load(text()).replace({"materials.x.reflection": 5})
    with pytest.raises(
        KeyError, match=r"'\*\.reflection' is a pattern, and names are expected here"
    ):
        load(text()).replace({"*.reflection": 0.5})
    scene = load(text())
    values = dict.fromkeys(scene.parameters("*.reflection"), 0.5)
    for value in scene.replace(values).parameters("*.reflection").values():
        assert value.numpy() == 0.5


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("materials.x.reflection", 1.01),
        ("materials.x.reflection", -0.01),
        ("materials.x.color", [1.01, -0.01, 0.5]),
        ("materials.x.specular", -0.01),
    ],
)
def test_replace_lets_small_steps_overstep_a_closed_range(load, name, value):
    """Differences and optimisers may step 0.01 beyond 0 or 1, where the image goes on smoothly.

    Ends that do not belong to the range, as 0 for a radius, are not overstepped (see above).
    """
    changed = load(text()).replace({name: value})
    np.testing.assert_allclose(changed.parameters(name)[name].numpy().ravel(), value, rtol=0)
    assert np.isfinite(picture(changed)).all()


# Structures


def test_structure_is_kept_in_a_loop_of_replace(load):
    """Whatever the numbers: the very same object, for which kernels are recorded."""
    start = load(text(), "single")
    first = start.replace({"materials.x.reflection": 0.1, "spheres.sphere0.center": [0, 0, 0.1]})
    moved = first
    for step in range(3):
        values = {
            "materials.x.reflection": 0.2 * step,
            "spheres.sphere0.center": [0, 0.1 * step, 0],
        }
        moved = moved.replace(values)
        assert moved.structure is first.structure
        assert start.replace(values).structure == first.structure
    # What was 0 in the file is compiled from the first time on that it is replaced
    assert first.structure != start.structure
    assert start.replace({"spheres.sphere0.center": [0, 0, 0.1]}).structure is start.structure
