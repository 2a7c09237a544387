"""Scenes for Mitsuba 3: they come back, what it lacks is refused, and both see the same."""

import re

import numpy as np
import pytest
import samples
from mitsuba_pictures import compare, picture
from samples import disc, light, material, plane, sphere, sun, three

import whitted as wt
from whitted.mitsuba.writing import write
from whitted.scene.dictionary import dictionary_of

# There and back

ROOM = "".join(
    plane(normal, offset, "white")
    for normal, offset in [
        ([1, 0, 0], 2.6),
        ([-1, 0, 0], 2.6),
        ([0, 2, 0], 2.8),
        ([0, -1, 0], 2.6),
        ([0, 0, -1], 3.6),
        ([0.1, 0.2, 1], 2.1),
    ]
)
TILES = {"color": [0.1, 0.3, 0.1], "size": 0.41}
LAMP = light([1.5, 2.4, 2.0], [9, 8, 7], "inverse-square", name="lamp")
PURE = "".join(
    [
        material("red", color=[0.8, 0.2, 0.1]),
        material("white", color=[0.9, 0.9, 0.8]),
        material("tiles", color=[0.9, 0.9, 0.8], checker=TILES),
        material("mirror", reflection=0.8),
        material("glass", reflection=1, refraction=1, ior=1.5, fresnel=True),
        material("water", reflection=0.9, refraction=0.7, ior=1.33, fresnel=True),
    ]
)
WIDE = samples.camera([0.1, 0.4, 2.2], [0, 0.1, 0], fov=80)
SQUARE = "".join(
    plane(normal, 2.6, "tiles") for normal in np.concatenate([np.eye(3), -np.eye(3)]).tolist()
)
PAIRS = {
    "one ball": "max_depth = 1\n" + samples.CAMERA + PURE + sphere([0, 0, 0], 0.6, "red") + LAMP,
    "balls and a disc": "max_depth = 1\n"
    + samples.camera([0.1, 0.4, 3.2], up=[0.3, 1, 0.1])
    + PURE
    + three("red", "white", "red")
    + disc([0, -0.8, 0], [0.1, 1, 0.2], 1.5, "red")
    + LAMP,
    "sun": "max_depth = 1\n"
    + samples.CAMERA
    + PURE
    + three("red", "white", "red")
    + sun([-0.5, -1.2, -0.7]),
    "room": "max_depth = 1\n" + WIDE + PURE + three("red", "white", "red") + ROOM + LAMP,
    "tiles": "max_depth = 1\n" + WIDE + PURE + three("red", "white", "red") + SQUARE + LAMP,
    "an eye close to a mirror": "background = [0.3, 0.5, 0.9]\nmax_depth = 4\n"
    + samples.CAMERA
    + PURE
    + sphere([-0.2, 0.4, 3.2], 0.2995, "mirror")
    + sphere([0, 0, 0], 0.6, "mirror"),
    "mirrors under a sky": "background = [0.3, 0.5, 0.9]\nmax_depth = 4\n"
    + samples.CAMERA
    + PURE
    + three("mirror", "mirror", "mirror")
    + disc([0, -0.8, 0], [0.1, 1, 0.2], 1.5, "mirror"),
}
# Balls of glass in water, beside a mirror, under a sky
NESTED = (
    "background = [1.0, 0.5, 0.2]\nmax_depth = 5\n"
    + samples.CAMERA
    + PURE
    + sphere([0, 0, 0], 0.9, "water", name="drop")
    + sphere([0.1, 0.1, 0.3], 0.4, "glass", name="glass")
    + sphere([1.3, 0, 0], 0.4, "mirror", name="mirror")
    + sphere([-1.3, 0, 0], 0.3, "glass")
)
# Light between matte surfaces has the square of their albedo, and so hardly counts
FAINT = (
    "max_depth = 5\n"
    + samples.CAMERA
    + material("faint", color=[8e-5, 2e-5, 1e-5])
    + PURE
    + sphere([0, 0.1, 0.4], 0.8, "glass")
    + disc([0, 0, -2], [0, 0, 1], 6, "faint")
    + light([0.9, 0.8, -1.2], [9e4, 8e4, 7e4], "inverse-square")
)


def used(found):
    """The numbers of a scene, without materials that no shape has."""
    made_of = {shape.material for shape in found.shapes}
    return {
        name: value
        for name, value in found.numbers.items()
        if not name.startswith("materials.") or name.split(".")[1] in made_of
    }


@pytest.mark.parametrize("text", [*PAIRS.values(), NESTED], ids=[*PAIRS, "nested glass"])
def test_there_and_back(load, text):
    """All numbers come back but for a rounding or two, and all names."""
    one = load(text)
    other = wt.from_mitsuba(one.to_mitsuba(), "double")
    before, after = used(one), used(other)
    assert list(before) == list(after)
    for name, value in before.items():
        np.testing.assert_allclose(after[name], value, rtol=4e-15, atol=4e-15, err_msg=name)
    assert [shape.material for shape in other.shapes] == [shape.material for shape in one.shapes]
    assert (other.max_depth, other.resolution) == (one.max_depth, one.resolution)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("path", samples.SHIPPED, ids=lambda path: path.stem)
def test_shipped_scenes_go_there_and_back_approximately(path):
    """What comes back has lost what Mitsuba lacks, and loses nothing more the second time."""
    one = wt.load_scene(path)
    first = wt.from_mitsuba(one.to_mitsuba(approximate=True), approximate=True)
    again = wt.from_mitsuba(first.to_mitsuba(approximate=True), approximate=True)
    assert list(first.numbers) == list(again.numbers)
    for name, value in first.numbers.items():
        # Single precision, and a factor of pi there and back
        np.testing.assert_allclose(again.numbers[name], value, rtol=5e-7, atol=5e-7, err_msg=name)
    assert [own.name for own in first.shapes] == [own.name for own in one.shapes]
    assert first.max_depth == one.max_depth


def test_names_that_are_no_keys_come_back(load):
    """Mitsuba has one set of keys for all; some are its own."""
    found = load(
        samples.CAMERA
        + material("ball", color=[1, 0, 0])
        + sphere([0, 0, 0], 0.5, "ball", name="ball")
        + sphere([2, 0, 0], 0.5, "ball", name="sensor")
        + sphere([4, 0, 0], 0.5, "ball", name="lights-x")
        + disc([-2, 0, 0], [0, 0, 1], 0.5, "ball", name="ball")
        + light([0, 3, 0], falloff="inverse-square", name="ball")
    )
    with pytest.warns(UserWarning, match="Mitsuba also follows light"):
        written = found.to_mitsuba()
    assert [key for key in written if key not in ("type", "integrator", "sensor")] == [
        "materials-ball",
        "ball",
        "spheres-sensor",
        "spheres-lights-x",
        "discs-ball",
        "lights-ball",
    ]
    with pytest.warns(UserWarning, match="Mitsuba also follows light"):
        assert list(wt.from_mitsuba(written).numbers) == list(found.numbers)


def test_a_dot_in_a_name_is_no_part_of_a_key(load):
    ball = sphere([0, 0, 0], 0.5, "red", name="a.b") + sphere([2, 0, 0], 0.5, "red", name="a_b")
    written = load("max_depth = 1\n" + samples.CAMERA + PURE + ball).to_mitsuba()
    assert [key for key, own in written.items() if own == written[key] and "a_b" in key] == [
        "a_b",
        "spheres-a_b",
    ]


# What has no exact counterpart in Mitsuba

OUT = "it is left out"
BALL = sphere([0, 0, 0], 0.5, "m")
LACKING = [
    (
        material("m", color=[1, 0, 0], specular=0.3) + BALL,
        ("materials.m.specular = 0.3: highlights have no counterpart in Mitsuba", OUT),
    ),
    (
        material("m", color=[1, 0, 0], shadow=0.5) + BALL,
        ("materials.m.shadow = 0.5: Mitsuba's shadows are full", OUT),
    ),
    (
        material("m", color=[0.1, 0, 0], reflection=0.5) + BALL,
        (
            "materials.m.color = [0.1, 0.0, 0.0]: a reflection beside a color has no counterpart",
            OUT,
        ),
    ),
    (
        material("m", color=[0.9, 0, 0], reflection=0.5) + BALL,
        ("materials.m.reflection = 0.5: a reflection beside a color has no counterpart", OUT),
    ),
    (
        material("m", reflection=0.5, checker=TILES) + disc([0, 0, 0], [0, 0, 1], 1, "m"),
        (
            'materials.m.checker = {"color": [0.1, 0.3, 0.1], "size": 0.41}: '
            "a reflection beside a color has no counterpart",
            OUT,
        ),
    ),
    (
        material("m", reflection=0.5, fresnel=True) + BALL,
        (
            "materials.m.reflection = 0.5: a reflection by the Fresnel equations of an opaque "
            "material has no counterpart",
            OUT,
        ),
    ),
    (
        material("m", refraction=0.5) + BALL,
        (
            "materials.m.fresnel = false: constant weights of glass have no counterpart",
            "they are shared out by the Fresnel equations",
        ),
    ),
    (
        material("m", color=[0.1, 0, 0], refraction=0.5, fresnel=True) + BALL,
        ("materials.m.color = [0.1, 0.0, 0.0]: the color of a glass has no counterpart", OUT),
    ),
    (
        material("m", refraction=0.5, fresnel=True) + BALL + sphere([0.6, 0, 0], 0.4, "m"),
        (
            "spheres.sphere1: this glass overlaps with 'spheres.sphere0'",
            "in Mitsuba each keeps its own index where they overlap",
        ),
    ),
    (
        material("m", color=[1, 0, 0]) + plane([0, 1, 0], 2, "m", name="floor"),
        (
            "planes.floor: a plane that is not a wall of a closed room has no counterpart",
            "a square of half side 3.23e+03 is taken",
        ),
    ),
    (
        light([0, 3, 0], name="key"),
        (
            'lights.key.falloff = "none": Mitsuba\'s lights fall off with the squared distance',
            "it is made as bright as here at camera.look_at",
        ),
    ),
]
SETTINGS = [
    ("ambient = [0.1, 0, 0]", ("ambient = [0.1, 0.0, 0.0]: has no counterpart in Mitsuba", OUT)),
    ("min_importance = 0.5", ("min_importance = 0.5: has no counterpart in Mitsuba", OUT)),
    (
        "background = [0.5, 0, 0]",
        (
            "background = [0.5, 0.0, 0.0]: "
            "in Mitsuba the sky lights matte surfaces, and the background here does not",
            "it is written as a sky",
        ),
    ),
]
MATTE = samples.CAMERA + material("m", color=[1, 0, 0]) + BALL


@pytest.mark.parametrize(
    ("text", "words"),
    [(samples.CAMERA + text, words) for text, words in LACKING]
    + [(f"{line}\n{MATTE}", words) for line, words in SETTINGS],
)
def test_what_mitsuba_lacks_is_refused_or_approximated(load, text, words):
    what, instead = words
    found = load(text)
    with pytest.raises(
        ValueError, match=f"^{re.escape(f'{what}; with approximate=True {instead}')}$"
    ):
        found.to_mitsuba()
    with pytest.warns(UserWarning, match=f"^{re.escape(f'{what}; {instead}')}$"):
        found.to_mitsuba(approximate=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            material("m", color=[1, 0, 0], checker=TILES) + disc([0, 0, 0], [0, 0, 1], 1, "m"),
            "materials.m.checker: expected only on planes that are square to an axis",
        ),
        (
            material("m", refraction=1, fresnel=True) + BALL + disc([0, 0, 2], [0, 0, 1], 1, "m"),
            "discs.disc0: glass without a volume has no counterpart in Mitsuba",
        ),
    ],
)
def test_what_mitsuba_cannot_even_approximate(load, text, message):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        load(samples.CAMERA + text).to_mitsuba(approximate=True)


def test_what_is_new_here_is_refused(load):
    """A kind of shape or of light that has come since is not left out without a word."""
    tables = dictionary_of(load(MATTE), whole=True)
    _, report = write({**tables, "cones": [], "lights": [{"name": "lamp", "type": "spot"}]})
    assert report.problems == [
        "cones: has no counterpart in Mitsuba",
        'lights.lamp.type = "spot": has no counterpart in Mitsuba',
    ]


def test_all_that_mitsuba_lacks_is_listed(load):
    text = samples.CAMERA + material("m", specular=1, shadow=0) + BALL + light([0, 3, 0])
    with pytest.raises(ValueError, match="falloff") as caught:
        load(text).to_mitsuba()
    assert [line.partition(" ")[0] for line in str(caught.value).splitlines()] == [
        "lights.light0.falloff",
        "materials.m.specular",
        "materials.m.shadow",
    ]


def test_what_makes_pictures_differ_warns(load):
    two = "max_depth = 2\n" + samples.CAMERA + PURE + three("red", "red", "mirror")
    with pytest.warns(
        UserWarning, match="^max_depth: Mitsuba also follows light .* brighter there$"
    ):
        load(two).to_mitsuba()
    inside = samples.CAMERA + PURE + sphere([0.1, 0.4, 3], 0.5, "glass", name="around")
    with pytest.warns(
        UserWarning, match="^spheres.around: the eye or a light is inside this glass"
    ):
        load(inside).to_mitsuba()


# Pictures


@pytest.mark.parametrize("text", PAIRS.values(), ids=PAIRS)
def test_pictures_agree(load, text):
    """Sample by sample, where Mitsuba draws nothing at random."""
    one = load(text)
    compare(picture(one.to_mitsuba()), one)


@pytest.mark.filterwarnings("ignore:.*Mitsuba also follows light")
@pytest.mark.parametrize("text", [NESTED, FAINT], ids=["glass in water", "glass before a disc"])
def test_pictures_with_glass_agree_in_the_mean(load, text):
    """Mitsuba follows one of the two rays that leave from glass, drawn at random.

    Its mean of 64 pictures is normally distributed. That one of 576 channels is 5 standard
    deviations off has a chance of 1 to 300; the seeds are always the same ones. Of our own error,
    with 256 samples beside exact edges, 0.1 % is taken to be one standard deviation. An index of
    1.47 in place of 1.5, or a weight of 0.97 in place of 1, fails by a factor of more than 1.6.
    """
    one = load(text)
    written = one.to_mitsuba()
    theirs = np.array([picture(written, 64, seed) for seed in range(64)])
    ours = wt.render(one, spp=256).numpy()
    noise = np.hypot(theirs.std(0, ddof=1) / 8, 1e-3 * ours.max())
    assert noise.max() < 0.01 * ours.max()
    assert (abs(theirs.mean(0) - ours) < 5 * noise).all()
