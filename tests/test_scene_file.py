"""Scene files: what is refused, with which words, and what is legal."""

import math
import re

import numpy as np
import pytest
import samples
from samples import plane, sphere

from whitted.scene.files import SceneError, load_scene
from whitted.scene.scene import MAX_OBJECTS
from whitted.shapes import Plane, Sphere

CAMERA = samples.camera([0, 0, 3], resolution=(8, 4))
BALL = samples.material("red") + sphere([0, 0, 0], 1, "red")
FLOOR = plane([0, 1, 0], 1, "red")
LIGHT = samples.light([0, 0, 2])
SUN = samples.sun([0, -1, 0])
TABLE = "expected a table"
NUMBERS = "expected three finite numbers"
RESOLUTION = "expected [width, height], two whole numbers of pixels > 0"
ANGLE = "expected an angle in degrees, in (0, 180)"
DEPTH = "expected a whole number from 1 to 256"
NAME = "expected a name, a string that is not empty"
ASKEW = "expected a direction not parallel to the view"


def changed(text, line):
    """A text with another line for a key, or with one more line."""
    key = line.split(" =")[0]
    return re.sub(rf"{key} = .*", line, text) if f"{key} =" in text else f"{text}{line}\n"


def camera(line):
    return changed(CAMERA, line)


def material(line):
    return f"{CAMERA}[materials.red]\n{line}\n"


def ball(line):
    return CAMERA + changed(BALL, line)


def floor(line):
    return CAMERA + samples.material("red") + changed(FLOOR, line)


def light(line):
    return CAMERA + changed(LIGHT, line)


PROBLEMS = [
    # Numbers that are not, and numbers out of range
    (ball("center = [0, nan, 0]"), f"spheres[0].center = [0, NaN, 0]: {NUMBERS}"),
    (ball("center = [0, inf, 0]"), f"spheres[0].center = [0, Infinity, 0]: {NUMBERS}"),
    (
        ball("center = [0, -1e40, 0]"),
        f"spheres[0].center = [0, -1e+40, 0]: {NUMBERS}, of at most 1e+18",
    ),
    (ball("center = [0, 0]"), f"spheres[0].center = [0, 0]: {NUMBERS}"),
    (ball('center = "origin"'), f'spheres[0].center = "origin": {NUMBERS}'),
    (ball("center = [true, 0, 0]"), f"spheres[0].center = [true, 0, 0]: {NUMBERS}"),
    (ball("radius = 0"), "spheres[0].radius = 0: expected a number > 0"),
    (ball("radius = -1.5"), "spheres[0].radius = -1.5: expected a number > 0"),
    (ball("radius = nan"), "spheres[0].radius = NaN: expected a number > 0"),
    (ball("radius = true"), "spheres[0].radius = true: expected a number > 0"),
    (
        floor("normal = [0, 0.0, 0]"),
        "planes[0].normal = [0, 0.0, 0]: expected a direction, not zero",
    ),
    (floor("offset = inf"), "planes[0].offset = Infinity: expected a finite number"),
    (material("ior = 0"), "materials.red.ior = 0: expected a number > 0"),
    (material("shininess = -5"), "materials.red.shininess = -5: expected a number > 0"),
    (material("specular = -0.1"), "materials.red.specular = -0.1: expected a number >= 0"),
    (material("reflection = 1.5"), "materials.red.reflection = 1.5: expected a number in [0, 1]"),
    (material("refraction = -1"), "materials.red.refraction = -1: expected a number in [0, 1]"),
    (
        material("color = [0, 2, 0]"),
        "materials.red.color = [0, 2, 0]: expected three numbers in [0, 1]",
    ),
    (material("fresnel = 1"), "materials.red.fresnel = 1: expected true or false"),
    (material("checker = 1"), f"materials.red.checker = 1: {TABLE}"),
    (
        material("checker = { color = [1, 1, 1], size = 0 }"),
        "materials.red.checker.size = 0: expected a number > 0",
    ),
    (
        material("checker = { color = [1, 1, 1] }"),
        "materials.red.checker.size: missing; expected a number > 0",
    ),
    (light("intensity = 1"), f"lights[0].intensity = 1: {NUMBERS}"),
    (
        light('falloff = "square"'),
        "lights[0].falloff = \"square\": expected 'none' or 'inverse-square'; "
        "did you mean 'inverse-square'?",
    ),
    (material("shadow = 1.2"), "materials.red.shadow = 1.2: expected a number in [0, 1]"),
    (
        light('type = "pint"'),
        "lights[0].type = \"pint\": expected 'point' or 'directional'; did you mean 'point'?",
    ),
    (
        light('type = "dirctional"'),
        "lights[0].type = \"dirctional\": expected 'point' or 'directional'; "
        "did you mean 'directional'?",
    ),
    (
        CAMERA + SUN.replace("[0, -1, 0]", "[0, 0, 0]"),
        "lights[0].direction = [0, 0, 0]: expected a direction, not zero",
    ),
    (camera("fov = 180"), f"camera.fov = 180: {ANGLE}"),
    (camera("fov = 0"), f"camera.fov = 0: {ANGLE}"),
    (
        camera("look_at = [0, 0, 3.0]"),
        "camera.look_at = [0, 0, 3.0]: expected a point other than camera.position",
    ),
    (camera("up = [0, 0, -2]"), f"camera.up = [0, 0, -2]: {ASKEW}"),
    (camera("up = [0, 0, 0]"), f"camera.up = [0, 0, 0]: {ASKEW}"),
    (camera("look_at = [0, -5, 3]"), f"camera.up = [0, 1, 0]: {ASKEW}"),
    (camera("resolution = [8, 0]"), f"camera.resolution = [8, 0]: {RESOLUTION}"),
    (camera("resolution = [8.5, 4]"), f"camera.resolution = [8.5, 4]: {RESOLUTION}"),
    (camera("resolution = 64"), f"camera.resolution = 64: {RESOLUTION}"),
    ("max_depth = 0\n" + CAMERA, f"max_depth = 0: {DEPTH}"),
    ("max_depth = 2.0\n" + CAMERA, f"max_depth = 2.0: {DEPTH}"),
    ("max_depth = 257\n" + CAMERA, f"max_depth = 257: {DEPTH}"),
    ("min_importance = -1\n" + CAMERA, "min_importance = -1: expected a number in [0, 1]"),
    ("background = [0, 0, inf]\n" + CAMERA, f"background = [0, 0, Infinity]: {NUMBERS}"),
    ("ambient = 0.1\n" + CAMERA, f"ambient = 0.1: {NUMBERS}"),
    # Missing and unknown keys, and tables that are something else
    ("", "camera: missing; expected a table"),
    ("camera = 5", f"camera = 5: {TABLE}"),
    ("spheres = 5\n" + CAMERA, "spheres = 5: expected a list of tables"),
    ("spheres = [5]\n" + CAMERA, f"spheres[0] = 5: {TABLE}"),
    ("materials = [1]\n" + CAMERA, f"materials = [1]: {TABLE}"),
    ("materials = { red = 1 }\n" + CAMERA, f"materials.red = 1: {TABLE}"),
    (CAMERA.replace("fov = 50\n", ""), f"camera.fov: missing; {ANGLE}"),
    (
        ball("radius = 1").replace("radius = 1\n", ""),
        "spheres[0].radius: missing; expected a number > 0",
    ),
    ("ambiant = [1, 1, 1]\n" + CAMERA, "ambiant: unknown key; did you mean 'ambient'?"),
    (
        "xyz = 1\n" + CAMERA,
        "xyz: unknown key; known are background, ambient, max_depth, min_importance, camera, "
        "materials, lights, spheres, planes, discs, clouds",
    ),
    (camera("position_ = [1, 1, 1]"), "camera.position_: unknown key; did you mean 'position'?"),
    (ball("radios = 1"), "spheres[0].radios: unknown key; did you mean 'radius'?"),
    (material("colour = [1, 1, 1]"), "materials.red.colour: unknown key; did you mean 'color'?"),
    (
        light("colour = 1"),
        "lights[0].colour: unknown key; known are position, intensity, falloff, name, type",
    ),
    (
        material("checker = { color = [1, 1, 1], size = 1, sise = 2 }"),
        "materials.red.checker.sise: unknown key; did you mean 'size'?",
    ),
    # Names
    (
        ball('material = "read"'),
        "spheres[0].material = \"read\": there is no such material; did you mean 'red'?",
    ),
    (ball('material = "glass"'), 'spheres[0].material = "glass": there is no such material'),
    (ball("material = 5"), "spheres[0].material = 5: expected the name of a material"),
    (
        CAMERA + sphere([0, 0, 0], 1, "red"),
        'spheres[0].material = "red": there is no such material; the scene has no materials',
    ),
    (ball('name = ""'), f'spheres[0].name = "": {NAME}'),
    (ball('name = "a\\nb"'), f'spheres[0].name = "a\\nb": {NAME}'),
    (ball("name = 5"), f"spheres[0].name = 5: {NAME}"),
    (
        CAMERA + '[[lights]]\nname = "a"\n' + LIGHT[11:] + LIGHT + 'name = "a"\n',
        'lights[1].name = "a": taken by lights[0]; names are unique',
    ),
    (
        ball('name = "sphere1"') + sphere([2, 0, 0], 1, "red"),
        'spheres[1].name = "sphere1": taken by spheres[0]; names are unique',
    ),
    (
        ball("radius = 1").replace(
            "[materials.red]", "[materials.red]\nchecker = { color = [1, 1, 1], size = 1 }"
        ),
        'spheres[0].material = "red": has a checker, which only planes and discs can show',
    ),
    (
        CAMERA + '[materials."odd name"]\nior = -1\n',
        'materials."odd name".ior = -1: expected a number > 0',
    ),
    # Long values are shortened
    (ball(f'center = "{"x" * 99}"'), f'spheres[0].center = "{"x" * 56}...: {NUMBERS}'),
]


@pytest.mark.parametrize(("text", "message"), PROBLEMS, ids=[message for _, message in PROBLEMS])
def test_problem_is_told_with_place_value_and_expectation(load, tmp_path, text, message):
    with pytest.raises(SceneError) as error:
        load(text)
    assert str(error.value) == f"{tmp_path / 'scene.toml'}: {message}"


def test_all_problems_are_listed(load, tmp_path):
    text = (
        samples.keys(ambiant=[0, 0, 0], max_depth=0)
        + samples.camera([0, 0, 3], [0, 0, 3], fov=200, resolution=(8, 4))
        + samples.material("glass", ior="nan", refration=1)
        + sphere([0, 0], -1, "glas")
        + plane([0, 0, 0], 1, "glass")
        + "[[lights]]\nintensity = [1, 1, 1]\n"
    )
    with pytest.raises(SceneError) as error:
        load(text)
    expected = [
        "ambiant: unknown key; did you mean 'ambient'?",
        f"max_depth = 0: {DEPTH}",
        f"camera.fov = 200: {ANGLE}",
        "camera.look_at = [0, 0, 3]: expected a point other than camera.position",
        "materials.glass.ior = NaN: expected a number > 0",
        "materials.glass.refration: unknown key; did you mean 'refraction'?",
        f"spheres[0].center = [0, 0]: {NUMBERS}",
        "spheres[0].radius = -1: expected a number > 0",
        "spheres[0].material = \"glas\": there is no such material; did you mean 'glass'?",
        "planes[0].normal = [0, 0, 0]: expected a direction, not zero",
        f"lights[0].position: missing; {NUMBERS}",
    ]
    assert sorted(str(error.value).split("\n")) == sorted(
        f"{tmp_path / 'scene.toml'}: {line}" for line in expected
    )


def test_too_many_objects_are_refused(load):
    planes = plane([0, 1, 0], 1, "red") * (MAX_OBJECTS + 1)
    told = f": {MAX_OBJECTS + 1} shapes and lights that are no spheres: "
    with pytest.raises(SceneError, match=f"{told}expected at most {MAX_OBJECTS}$"):
        load(CAMERA + "[materials.red]\n" + planes)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("[camera\n", "1:8"),
        (CAMERA + "fov = 3\n", "6:8"),
        (CAMERA + "\n  a = = 3\n", "7:7"),
        (CAMERA + "[camera]\n", "6:8"),
    ],
)
def test_malformed_toml_is_refused_with_its_place(load, tmp_path, text, place):
    with pytest.raises(
        SceneError, match=f"^{re.escape(str(tmp_path / 'scene.toml'))}:{place}: not valid TOML: "
    ) as error:
        load(text)
    assert "\n" not in str(error.value)


def test_unfinished_toml_is_refused(load):
    with pytest.raises(SceneError, match=r"not valid TOML: ") as error:
        load('name = """abc')
    assert "\n" not in str(error.value)


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(
        SceneError, match=r"nothing\.toml: cannot be read: No such file or directory$"
    ):
        load_scene(tmp_path / "nothing.toml")


def test_directory_is_refused(tmp_path):
    with pytest.raises(
        SceneError, match=f"^{re.escape(str(tmp_path))}: cannot be read: Is a directory$"
    ):
        load_scene(tmp_path)


def test_byte_order_mark_is_no_part_of_the_text(tmp_path):
    """Some editors begin a file with one. Places in messages are those without it."""
    path = tmp_path / "mark.toml"
    plain = samples.SHIPPED[0]
    path.write_bytes(b"\xef\xbb\xbf" + plain.read_bytes())
    assert load_scene(path) == load_scene(plain)
    path.write_bytes(b"\xef\xbb\xbfa = b")
    with pytest.raises(SceneError, match=r"mark\.toml:1:5: not valid TOML"):
        load_scene(path)


def test_text_that_is_not_utf8_is_refused(tmp_path):
    path = tmp_path / "latin.toml"
    path.write_bytes("# Größe\n".encode("latin-1"))
    with pytest.raises(
        SceneError, match=r"latin\.toml: not a text file in UTF-8: byte 4 is not valid$"
    ):
        load_scene(path)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 5000 + "]" * 5000,
        "a = " + "{a = " * 5000 + "1" + "}" * 5000,
        "a = " + "9" * 5000,
    ],
)
def test_text_that_overwhelms_the_parser_is_refused(load, text):
    with pytest.raises(SceneError, match=r"not valid TOML: |a: unknown key"):
        load(text)


def test_precision_is_checked(tmp_path):
    with pytest.raises(ValueError, match=r"^precision: expected 'single' or 'double', got 'half'$"):
        load_scene(tmp_path / "any.toml", "half")


def test_path_may_be_text(tmp_path):
    (tmp_path / "scene.toml").write_text(CAMERA)
    assert load_scene(str(tmp_path / "scene.toml")).resolution == (8, 4)


def test_defaults_are_those_of_the_contract(load):
    scene = load(CAMERA + BALL + LIGHT)
    assert (scene.max_depth, scene.min_importance, scene.camera.up, scene.resolution) == (
        5,
        0,
        (0, 1, 0),
        (8, 4),
    )
    (red,) = scene.materials
    assert (red.name, red.fresnel, red.checker, scene.lights[0].falloff) == (
        "red",
        False,
        None,
        "none",
    )
    defaults = {
        "color": (0, 0, 0),
        "specular": 0,
        "shininess": 50,
        "reflection": 0,
        "refraction": 0,
        "ior": 1.5,
        "shadow": 1,
    }
    values = {f"materials.red.{key}": value for key, value in defaults.items()} | {
        "background": (0,) * 3,
        "ambient": (0,) * 3,
    }
    for name, array in scene.parameters(*values).items():
        np.testing.assert_array_equal(np.array(array).ravel(), values[name], err_msg=name)


def test_every_key_arrives(load):
    checker = {"color": [0.9, 0.8, 0.7], "size": 0.6}
    m = {
        "color": [0.1, 0.2, 0.3],
        "specular": 0.4,
        "shininess": 5,
        "reflection": 0.6,
        "refraction": 0.7,
        "ior": 0.8,
        "shadow": 0.5,
        "fresnel": True,
        "checker": checker,
    }
    head = {"background": [1, 2, 3], "ambient": [4, 5, 6], "max_depth": 7, "min_importance": 0.25}
    scene = load(
        samples.keys(**head)
        + camera("up = [0, 2, 1]")
        + samples.material("m", **m)
        + samples.material("n")
        + sphere([1, 2, 3], 4, "n", name="ball")
        + plane([0, 3, 4], 7, "m", name="floor")
        + samples.disc([1, 1, 2], [0, 6, 8], 3, "m", name="plate")
        + samples.light([1, 2, 3], [4, 5, 6], "inverse-square", name="key")
        + samples.sun([0, -3, 4], [1, 2, 3], name="sun")
    )
    assert (scene.max_depth, scene.min_importance, scene.camera.up, scene.lights[0].falloff) == (
        *(7, 0.25, (0, 2, 1)),
        "inverse-square",
    )
    assert scene.materials[0].fresnel
    expected = {
        "spheres.ball.center": [1, 2, 3],
        "spheres.ball.radius": [4],
        "planes.floor.normal": [0, 0.6, 0.8],
        "planes.floor.offset": [7],
        "materials.m.color": [0.1, 0.2, 0.3],
        "materials.m.specular": [0.4],
        "materials.m.shininess": [5],
        "materials.m.reflection": [0.6],
        "materials.m.refraction": [0.7],
        "materials.m.ior": [0.8],
        "materials.m.shadow": [0.5],
        "materials.m.checker.color": [0.9, 0.8, 0.7],
        "materials.m.checker.size": [0.6],
        "discs.plate.center": [1, 1, 2],
        "discs.plate.normal": [0, 0.6, 0.8],
        "discs.plate.radius": [3],
        "lights.sun.direction": [0, -0.6, 0.8],
        "lights.sun.irradiance": [1, 2, 3],
        "lights.key.position": [1, 2, 3],
        "lights.key.intensity": [4, 5, 6],
        "camera.position": [0, 0, 3],
        "camera.look_at": [0, 0, 0],
        "camera.fov": [50],
        "background": [1, 2, 3],
        "ambient": [4, 5, 6],
    }
    for name, array in scene.parameters(*expected).items():
        # 0.6 and 0.8 are quotients of rounded numbers
        np.testing.assert_allclose(
            np.array(array).ravel(), expected[name], rtol=1e-15, err_msg=name
        )


def test_default_names_count_from_zero(load):
    text = (
        CAMERA
        + BALL
        + 'name = "ball"\n'
        + sphere([2, 0, 0], 1, "red")
        + plane([0, 1, 0], 1, "red")
        + LIGHT * 2
    )
    scene = load(text)
    assert [x.name for x in (*scene.shapes, *scene.lights)] == [
        "ball",
        "sphere1",
        "plane0",
        "light0",
        "light1",
    ]


def test_precision_decides_the_types(load):
    assert type(load(CAMERA, "single").camera.fov).__name__ == "Float"
    assert type(load(CAMERA, "double").camera.fov).__name__ == "Float64"


@pytest.mark.parametrize(
    ("text", "counts"),
    [
        ("", (0, 0, 0)),
        (LIGHT, (0, 0, 1)),
        ("[materials.red]\n", (0, 0, 0)),
        (BALL, (1, 0, 0)),
        ("[materials.red]\n" + FLOOR, (0, 1, 0)),
    ],
)
def test_nothing_but_a_camera_is_needed(load, text, counts):
    scene = load(CAMERA + text)
    assert (
        *(sum(isinstance(x, kind) for x in scene.shapes) for kind in (Sphere, Plane)),
        len(scene.lights),
    ) == counts


def test_object_of_one_kind_may_be_named_like_one_of_another(load):
    scene = load(CAMERA + BALL + 'name = "a"\n' + LIGHT + 'name = "a"\n')
    assert {"spheres.a.radius", "lights.a.position"} <= set(scene.parameters())


def test_extremes_are_legal(load):
    text = (
        camera("fov = 179.9")
        + BALL.replace("radius = 1", "radius = 1e-10").replace("[0, 0, 0]", "[1e17, -1e17, 0]")
        + LIGHT
    )
    scene = load(text + plane([0, 1e-12, 0], -1e9, "red"))
    assert math.isclose(np.array(scene.shapes[0].radius).item(), 1e-10)
    np.testing.assert_array_equal(np.array(scene.shapes[1].normal).ravel(), [0, 1, 0])
