"""Scenes written as files: what has not changed stays, and a file reads back as the same scene."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_scenes import LAYOUTS
from samples import SHIPPED
from strategies import scenes

import whitted as wt

TEXT = """# a scene
background = [0.1, 0.2, 0.3]   # dusk

[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
fov = 50   # vertical
resolution = [8, 8]

[materials."lead glass"]
ior = 1.6          # a guess
color = [0, 0, 0]

[[spheres]]
center = [0, 0, 0]     # in the middle
radius = 1
material = "lead glass"

[[spheres]]
name = "b.c"           # the second one
center = [2, 0, 0]
radius = 0.5
material = "lead glass"

[[planes]]
normal = [0, 3, 0]     # of any length
offset = 1
material = "lead glass"

[[lights]]
name = "key"
position = [1, 2, 3]
intensity = [1, 1, 1]
"""
MADE = 'material = "lead glass"'
GREEN = wt.Material("green", color=(0, 0.5, 0))
# Changes, the lines that they take out, and those that they put in
CHANGES = {
    "nothing": (lambda scene: scene, [], []),
    "a number": (
        lambda scene: scene.replace({"materials.lead glass.ior": 1.75}),
        ["ior = 1.6          # a guess"],
        ["ior = 1.75          # a guess"],
    ),
    "a number as it was": (
        lambda scene: scene.replace({"planes.plane0.normal": [0, 1, 0], "camera.fov": 50}),
        [],
        [],
    ),
    "a vector": (
        lambda scene: scene.replace({"spheres.sphere0.center": [1, 2, 3]}),
        ["center = [0, 0, 0]     # in the middle"],
        ["center = [1.0, 2.0, 3.0]     # in the middle"],
    ),
    "a number that the file leaves out": (
        lambda scene: scene.replace({"materials.lead glass.specular": 0.25}),
        [],
        ["specular = 0.25"],
    ),
    "a number that becomes the default": (
        lambda scene: scene.replace({"materials.lead glass.ior": 1.5}),
        ["ior = 1.6          # a guess"],
        ["ior = 1.5          # a guess"],
    ),
    "settings": (
        lambda scene: scene.replace({"max_depth": 3, "lights.key.falloff": "inverse-square"}),
        [],
        ["max_depth = 3", 'falloff = "inverse-square"'],
    ),
    "a light of another kind": (
        lambda scene: scene.replace(
            {"lights.key": wt.DirectionalLight(direction=(0, -1, 0), irradiance=(1, 1, 1))}
        ),
        ["position = [1, 2, 3]", "intensity = [1, 1, 1]"],
        ['type = "directional"', "direction = [0.0, -1.0, 0.0]", "irradiance = [1.0, 1.0, 1.0]"],
    ),
    "a thing less": (
        lambda scene: scene.remove("sphere0"),
        ["[[spheres]]", "center = [0, 0, 0]     # in the middle", "radius = 1", MADE],
        [],
    ),
    "a default name at another place": (
        lambda scene: scene.add(
            wt.Sphere(center=(1, 1, 1), radius=2, material="lead glass")
        ).remove("b.c"),
        ['name = "b.c"           # the second one', "center = [2, 0, 0]", "radius = 0.5"],
        ['name = "sphere2"', "center = [1.0, 1.0, 1.0]", "radius = 2.0"],
    ),
    "more things": (
        lambda scene: scene.add(wt.Plane(normal=(0, 0, 1), offset=2, material=GREEN)),
        [],
        ["[[planes]]", "normal = [0.0, 0.0, 1.0]", "offset = 2.0", 'material = "green"']
        + ["[materials.green]", "color = [0.0, 0.5, 0.0]"],
    ),
    "things of a kind that the file has not": (
        lambda scene: scene.add(
            wt.Disc(center=(0, 0, 0), normal=(0, 0, 1), radius=2, material="lead glass")
        ),
        [],
        ["[[discs]]", "center = [0.0, 0.0, 0.0]", "normal = [0.0, 0.0, 1.0]", "radius = 2.0"]
        + [MADE],
    ),
}
CAMERA = "camera = { position = [0, 0, 4], look_at = [0, 0, 0], fov = 50, resolution = [8, 8] }\n"
BALL = '{ center = [0, 0, 0], radius = 1, material = "a" }'
# The same scene, written in other ways
FORMS = {
    "tables in lines": CAMERA + f"spheres = [{BALL}]\nmaterials = {{ a = {{ ior = 2 }} }}\n",
    "dotted keys": CAMERA + f"spheres = [{BALL}]\nmaterials.a.ior = 2\nmaterials.a.shadow = 0\n",
    "empty lists": CAMERA + "spheres = []\nlights = []\nmaterials.a.ior = 2\n",
    "tables apart": "[materials.a]\nior = 2\n[[lights]]\nposition = [1, 1, 1]\n"
    "intensity = [1, 1, 1]\n[materials.b]\n[camera]\n"
    + CAMERA[11:-3].replace("], ", "]\n").replace("50, ", "50\n"),
    "nothing but a camera": CAMERA,
}


def saved(scene, path):
    """The text of a scene's file, which reads back as that scene."""
    scene.save(path)
    assert wt.load_scene(path, scene.precision.name) == scene
    return path.read_text()


@pytest.mark.parametrize("change", CHANGES)
def test_only_lines_that_say_something_else_change(tmp_path, change):
    edit, less, more = CHANGES[change]
    text = saved(edit(wt.parse_scene(TEXT)), tmp_path / "a.toml")
    before, after = TEXT.splitlines(), text.splitlines()
    for line in less:
        before.remove(line)
    assert sorted(filter(None, after)) == sorted(filter(None, before + more))


@pytest.mark.parametrize("form", FORMS)
def test_files_may_be_written_in_any_way(tmp_path, form):
    path = tmp_path / "a.toml"
    scene = wt.parse_scene(FORMS[form])
    assert saved(scene, path) == FORMS[form]
    green = wt.Material("green", checker=wt.Checkerboard(color=(1, 1, 1), size=2))
    larger = scene.add(
        wt.Sphere("more", center=(2, 2, 2), radius=1, material=wt.Material("red")),
        wt.Plane(normal=(0, 0, 1), offset=1, material=green),
        wt.DirectionalLight(direction=(0, 0, -1), irradiance=(1, 1, 1)),
    )
    moved = larger.replace({"camera.fov": 40, "planes.plane0.offset": 2, "max_depth": 9})
    saved(moved, path)
    # What is added to the file that was written, and taken from it, goes as well
    again = wt.load_scene(path)
    saved(again.replace({"materials.green.checker": None, "spheres.more.radius": 3}), path)
    everything = [f"{kind.group}.{kind.name}" for kind in again.shapes]
    empty = again.remove(*everything, *(f"lights.{light.name}" for light in again.lights))
    saved(empty.remove(*(own.name for own in empty.materials)), path)


@pytest.mark.parametrize("file", SHIPPED, ids=lambda path: path.stem)
def test_shipped_scene_is_saved_as_it_is(tmp_path, file):
    scene = wt.load_scene(file)
    assert saved(scene, tmp_path / "a.toml") == file.read_text()
    # Without its text, all of it is written anew
    saved(wt.Scene.from_dict(scene.to_dict()), tmp_path / "b.toml")


@given(
    scenes(LAYOUTS["mixed"], generic=False),
    scenes(LAYOUTS["mixed"], generic=False),
    st.sampled_from(["single", "double"]),
)
def test_any_scene_is_read_back_as_it_was(tmp_path_factory, numbers, others, precision):
    """Written by a test, read, changed, saved, and read again."""
    path = tmp_path_factory.mktemp("save") / "a.toml"
    scene = wt.parse_scene(LAYOUTS["mixed"].text(numbers), precision)
    for name, value in scene.parameters(*numbers).items():
        # Half a spacing of single precision
        np.testing.assert_allclose(value.numpy().ravel(), np.ravel(numbers[name]), rtol=6e-8)
    saved(scene, path)
    saved(scene.replace(others), path)


# What a user writes by hand: comments above, behind and between tables
COMMENTED = """# My scene

background = [0, 0, 0]

# The eye
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
fov = 50
resolution = [8, 8]

# Like paper
[materials.white]
color = [0.8, 0.8, 0.8]
# specular = 0.1

# A mirror
[materials.mirror]
reflection = 1

# --- the balls ---

# the left one,
# which is small
[[spheres]]
name = "left"
center = [-1, 0, 0]
radius = 0.3
material = "white"

# the right one
[[spheres]]
name = "right"
center = [1, 0, 0]
radius = 0.5  # a half
material = "mirror"

# the floor
[[planes]]
normal = [0, 1, 0]
offset = 1
material = "white"

# over the eye
[[lights]]
position = [0, 3, 4]
intensity = [1, 1, 1]
# the end
"""
LEFT = """# the left one,
# which is small
[[spheres]]
name = "left"
center = [-1, 0, 0]
radius = 0.3
material = "white"

"""
RIGHT = """# the right one
[[spheres]]
name = "right"
center = [1, 0, 0]
radius = 0.5  # a half
material = "mirror"

"""
MORE = wt.Sphere("more", center=(0, 2, 0), radius=1, material="white")
ADDED = """[[spheres]]
name = "more"
center = [0.0, 2.0, 0.0]
radius = 1.0
material = "white"

"""


def left_again(scene):
    """The first ball, removed and added."""
    (left,) = (own for own in scene.to_dict()["spheres"] if own["name"] == "left")
    return scene.remove("left").add(wt.Sphere(**left))


# Changes, and what each puts where in the text
REARRANGED = {
    "the first of two goes": (lambda scene: scene.remove("left"), [(LEFT, "")]),
    "the last of two goes": (lambda scene: scene.remove("right"), [(RIGHT, "")]),
    "both go": (lambda scene: scene.remove("left", "right"), [(LEFT, ""), (RIGHT, "")]),
    "the last of all goes": (
        lambda scene: scene.remove("light0"),
        [(COMMENTED[COMMENTED.index("\n# over the eye") :], "")],
    ),
    "one more": (lambda scene: scene.add(MORE), [(RIGHT, RIGHT + ADDED)]),
    "one goes, and one comes": (
        lambda scene: scene.remove("left").add(MORE),
        [(LEFT, ""), (RIGHT, RIGHT + ADDED)],
    ),
    "one goes, and comes again": (left_again, [(LEFT, ""), (RIGHT, RIGHT + LEFT)]),
    "the last one goes, and comes again": (
        lambda scene: scene.remove("light0").add(
            wt.PointLight("light0", position=(0, 3, 4), intensity=(1, 1, 1))
        ),
        [],
    ),
    "one comes again after another": (
        lambda scene: left_again(scene.add(MORE)),
        [(LEFT, ""), (RIGHT, RIGHT + ADDED + LEFT)],
    ),
    "the first of a kind": (
        lambda scene: scene.add(
            wt.Disc("table", center=(0, 0, 0), normal=(0, 1, 0), radius=1, material="white")
        ),
        [
            (
                "# the end\n",
                '# the end\n\n[[discs]]\nname = "table"\ncenter = [0.0, 0.0, 0.0]\n'
                'normal = [0.0, 1.0, 0.0]\nradius = 1.0\nmaterial = "white"\n',
            )
        ],
    ),
    "a material more": (
        lambda scene: scene.add(wt.Material("red", color=(1, 0, 0))),
        [("reflection = 1\n", "reflection = 1\n\n[materials.red]\ncolor = [1.0, 0.0, 0.0]\n")],
    ),
    "a material less": (
        lambda scene: scene.remove("right", "mirror"),
        [(RIGHT, ""), ("# A mirror\n[materials.mirror]\nreflection = 1\n\n", "")],
    ),
    "a key more": (
        lambda scene: scene.replace({"materials.white.ior": 2}),
        [("# specular = 0.1\n", "# specular = 0.1\nior = 2.0\n")],
    ),
    "a key before all tables": (
        lambda scene: scene.replace({"max_depth": 2}),
        [("background = [0, 0, 0]\n", "background = [0, 0, 0]\nmax_depth = 2\n")],
    ),
}


@pytest.mark.parametrize("change", REARRANGED)
def test_comments_stay_with_their_table(tmp_path, change):
    edit, changes = REARRANGED[change]
    expected = COMMENTED
    for before, after in changes:
        assert before in expected
        expected = expected.replace(before, after)
    assert saved(edit(wt.parse_scene(COMMENTED)), tmp_path / "a.toml") == expected


BARE = f"# bare\n{TEXT[TEXT.index('[camera]') : TEXT.index('[[planes]]')]}"


def test_line_endings_of_other_systems_stay(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(COMMENTED.replace("\n", "\r\n").encode())
    wt.load_scene(path).remove("left").add(MORE).save(path)
    expected = COMMENTED.replace(LEFT, "").replace(RIGHT, RIGHT + ADDED)
    assert path.read_bytes() == expected.replace("\n", "\r\n").encode()


def test_a_file_without_keys_before_its_tables_gets_one(tmp_path):
    scene = wt.parse_scene(BARE.removeprefix("# bare\n"))
    text = saved(scene.replace({"max_depth": 2}), tmp_path / "a.toml")
    assert text.startswith("max_depth = 2\n\n[camera]\n")
    text = saved(wt.parse_scene(BARE).replace({"max_depth": 2}), tmp_path / "a.toml")
    assert text.startswith("max_depth = 2\n\n# bare\n[camera]\n")


def test_a_file_may_begin_with_what_is_removed(tmp_path):
    light = "[[lights]]\nposition = [1, 1, 1]\nintensity = [1, 1, 1]\n\n"
    scene = wt.parse_scene(light + BARE)
    assert saved(scene.remove("light0"), tmp_path / "a.toml") == BARE.rstrip("\n") + "\n\n"


def test_values_over_several_lines_are_no_headers(tmp_path):
    text = BARE.replace("center = [0, 0, 0] ", "center = [\n  # x, y, z\n  0,\n  0, 0\n]")
    scene = wt.parse_scene(text.replace("resolution = [8, 8]", "resolution = [\n8,\n8]"))
    assert "# x, y, z" in saved(scene.remove("b.c"), tmp_path / "a.toml")
    nested = (
        CAMERA + 'spheres = [\n# one\n{ center = [\n0, 0, 0], radius = 1, material = "a" }\n]\n'
    )
    scene = wt.parse_scene(nested + "[materials.a]\n")
    assert "# one" in saved(scene.replace({"camera.fov": 20}), tmp_path / "a.toml")


def test_a_file_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(OSError, match="a folder; name a file"):
        wt.parse_scene(TEXT).save(tmp_path)


def test_numbers_over_the_end_of_a_range_are_saved_as_the_end(tmp_path):
    """A step of an optimiser may lead there; a file may not have it."""
    over = wt.parse_scene(TEXT).replace({"materials.lead glass.reflection": 1.004})
    over.save(tmp_path / "a.toml")
    (value,) = wt.load_scene(tmp_path / "a.toml").parameters("*.reflection").values()
    assert value.numpy() == 1
    # Other changes leave it as it is
    assert over.replace({"max_depth": 2}).numbers["materials.lead glass.reflection"][0] > 1.003


def test_byte_order_mark_is_left_out(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xef\xbb\xbf" + TEXT.encode())
    scene = wt.load_scene(path)
    assert saved(scene.replace({"camera.fov": 40}), path) == TEXT.replace("fov = 50", "fov = 40.0")
