"""Scenes made and changed in Python: what is accepted, refused with which words, and equal."""

import copy
import inspect
import pickle
from pathlib import Path

import drjit as dr
import numpy as np
import pytest
import samples
from drjit.llvm import ad
from hypothesis import given
from hypothesis import strategies as st
from random_scenes import LAYOUTS, UP
from samples import SCENES, SHIPPED
from strategies import scenes
from test_scene_file import ANGLE, ASKEW, DEPTH, NAME, NUMBERS, RESOLUTION

import whitted as wt
from whitted.core.parameter import REQUIRED, parameters_of, settings_of
from whitted.lights import LIGHTS
from whitted.scene.things import LIGHTS as LIGHTS_IN_PYTHON
from whitted.scene.things import SHAPES as SHAPES_IN_PYTHON
from whitted.shapes import SHAPES

CAMERA = wt.Camera(position=(0, 0, 3), look_at=(0, 0, 0), fov=50, resolution=(8, 4))
RED = wt.Material("red", color=(0.8, 0.2, 0.1))
CHECKS = wt.Material("checks", checker=wt.Checkerboard(color=(1, 1, 1), size=0.5))
BALL = wt.Sphere("ball", center=(0, 0, 0), radius=0.5, material=RED)
FLOOR = wt.Plane("floor", normal=(0, 1, 0), offset=1, material=CHECKS)
KEY = wt.PointLight("key", position=(1, 3, 2), intensity=(1, 1, 1))
# A cloud takes its spheres in two ways: see `test_clouds.py`
SINGLE = tuple(kind for kind in SHAPES_IN_PYTHON if kind is not wt.Cloud)
KINDS = (wt.Camera, wt.Checkerboard, wt.Material, *SINGLE, *LIGHTS_IN_PYTHON)
# A number, and a vector, in all forms that are taken
FORMS = {
    "Python": (float, tuple),
    "list": (float, list),
    "NumPy": (np.float64, np.array),
    "NumPy array": (np.array, lambda v: np.array(v)[:, None]),
    "Dr.Jit": (ad.Float64, lambda v: ad.Array3f64(*map(float, v))),
    "flat Dr.Jit": (ad.Float64, lambda v: ad.Float64(*map(float, v))),
    "tensor": (lambda x: ad.TensorXf64([x], (1,)), lambda v: ad.TensorXf64([*v], (3,))),
}


def scene(**more):
    return wt.Scene(CAMERA, **{"spheres": [BALL], "planes": [FLOOR], "lights": [KEY], **more})


def sphere(**more):
    return wt.Sphere("a", **{"center": (0, 0, 0), "radius": 1, "material": "red", **more})


def test_every_kind_of_thing_has_a_constructor():
    assert tuple(kind.kind for kind in SINGLE) == SHAPES
    assert tuple(kind.kind for kind in LIGHTS_IN_PYTHON) == tuple(LIGHTS.values())
    assert all(getattr(wt, kind.__name__) is kind for kind in KINDS)
    groups = set(inspect.signature(wt.Scene).parameters)
    assert {kind.group for kind in SHAPES} <= groups


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_constructor_has_the_arguments_and_the_defaults_of_a_file(kind):
    """Signatures are written out, for completion and type checkers."""
    given = inspect.signature(kind).parameters
    fields = {key: field for key, field in kind.model().model_fields.items() if key != "type"}
    assert set(given) == set(fields)
    for key, one in given.items():
        expected = REQUIRED if fields[key].is_required() else fields[key].default
        default = REQUIRED if one.default is one.empty else one.default
        assert (list(default) if isinstance(default, tuple) else default) == expected, key
        assert (one.kind is one.KEYWORD_ONLY) == (key != "name")
        assert one.annotation is not one.empty
    assert {*parameters_of(kind.kind), *settings_of(kind.kind)} <= set(given)


def test_scene_has_the_defaults_of_a_file():
    assert wt.Scene(CAMERA) == wt.parse_scene(samples.camera([0, 0, 3], resolution=(8, 4)))


@pytest.mark.parametrize("form", FORMS)
def test_numbers_of_python_numpy_and_drjit_are_taken(form):
    number, vector = FORMS[form]
    made = wt.Scene(
        wt.Camera(
            position=vector((0, 0, 3)),
            look_at=vector((0, 0, 0)),
            fov=number(50),
            resolution=np.array([8, 4]),
        ),
        spheres=[wt.Sphere("ball", center=vector((0, 0, 0)), radius=number(0.5), material=RED)],
        planes=[wt.Plane("floor", normal=vector((0, 1, 0)), offset=number(1), material=CHECKS)],
        lights=[wt.PointLight("key", position=vector((1, 3, 2)), intensity=vector((1, 1, 1)))],
        background=vector((0, 0, 0)),
        max_depth=np.int64(5),
        min_importance=number(0),
    )
    assert made == scene()
    assert wt.Scene.from_dict({**made.to_dict(), "ambient": vector((0, 0, 0))}) == scene()


def test_settings_of_numpy_are_taken():
    assert wt.Material("m", fresnel=np.True_) == wt.Material("m", fresnel=True)


def test_numbers_that_carry_gradients_are_refused():
    """They would be lost: a description holds plain numbers."""
    radius = ad.Float64(1)
    dr.enable_grad(radius)
    message = (
        r"^spheres\.a\.radius: an array that carries gradients; give dr\.detach of it here, and "
        r"the array itself to Scene\.replace$"
    )
    with pytest.raises(wt.SceneError, match=message):
        sphere(radius=radius)


MATERIAL = "expected a Material, or the name of one"
PROBLEMS = {
    "spheres.a.radius = -1: expected a number > 0": lambda: sphere(radius=-1),
    "spheres.a.radius = NaN: expected a number > 0": lambda: sphere(radius=ad.Float(np.nan)),
    f"spheres.a.center = [0, 0]: {NUMBERS}": lambda: sphere(center=(0, 0)),
    f"spheres.a.center = [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]: {NUMBERS}": lambda: sphere(
        center=dr.zeros(ad.Array3f, 2)
    ),
    f"spheres.a.material = 5: {MATERIAL}": lambda: sphere(material=5),
    f"spheres.a.material = None: {MATERIAL}": lambda: sphere(material=None),
    f'sphere.name = "a\\nb": {NAME}': lambda: wt.Sphere(
        "a\nb", center=(0, 0, 0), radius=1, material="m"
    ),
    f'sphere.name = "": {NAME}': lambda: wt.Sphere("", center=(0, 0, 0), radius=1, material="m"),
    "spheres.a.center: missing; expected three finite numbers\n"
    f"spheres.a.material: missing; {MATERIAL}\n"
    "spheres.a.radios: unknown key; did you mean 'radius'?": lambda: wt.Sphere(
        "a", radius=1, radios=2
    ),
    "plane.normal = [0, 0, 0]: expected a direction, not zero": lambda: wt.Plane(
        normal=(0, 0, 0), offset=1, material="m"
    ),
    "disc.radius = 0: expected a number > 0": lambda: wt.Disc(
        center=(0, 0, 0), normal=(0, 0, 1), radius=0, material="m"
    ),
    "lights.a.falloff = \"square\": expected 'none' or 'inverse-square'; "
    "did you mean 'inverse-square'?": lambda: wt.PointLight(
        "a", position=(0, 0, 0), intensity=(1, 1, 1), falloff="square"
    ),
    "lights.a.type: unknown key; known are position, intensity, falloff, name": lambda: (
        wt.PointLight("a", position=(0, 0, 0), intensity=(1, 1, 1), type="point")
    ),
    "light.direction = [0, 0, 0]: expected a direction, not zero": lambda: wt.DirectionalLight(
        direction=(0, 0, 0), irradiance=(1, 1, 1)
    ),
    "materials.m.color = [0, 2, 0]: expected three numbers in [0, 1]": lambda: wt.Material(
        "m", color=(0, 2, 0)
    ),
    "materials.m.fresnel = 1: expected true or false": lambda: wt.Material("m", fresnel=1),
    f"material.name: missing; {NAME}": lambda: wt.Material(),
    "materials.m.checker.size = 0: expected a number > 0": lambda: wt.Material(
        "m", checker={"color": (1, 1, 1), "size": 0}
    ),
    "materials.m.checker = 1: expected a Checkerboard": lambda: wt.Material("m", checker=1),
    "checker.size = 0: expected a number > 0": lambda: wt.Checkerboard(color=(1, 1, 1), size=0),
    f"camera.fov = 180: {ANGLE}": lambda: wt.Camera(
        position=(0, 0, 1), look_at=(0, 0, 0), fov=180, resolution=(1, 1)
    ),
    f"camera.resolution = [8.5, 4]: {RESOLUTION}": lambda: wt.Camera(
        position=(0, 0, 1), look_at=(0, 0, 0), fov=50, resolution=(8.5, 4)
    ),
    f"camera.up = [0, 0, 1]: {ASKEW}": lambda: wt.Camera(
        position=(0, 0, 1), look_at=(0, 0, 0), fov=50, resolution=(1, 1), up=(0, 0, 1)
    ),
    # Of whole scenes
    "spheres[0].material = \"read\": there is no such material; did you mean 'red'?": lambda: (
        wt.Scene(CAMERA, spheres=[sphere(material="read")], materials=[RED])
    ),
    'spheres[0].material = "red": there is no such material; the scene has no materials': lambda: (
        wt.Scene(CAMERA, spheres=[sphere()])
    ),
    'spheres[0].material = "checks": has a checker, which only planes and discs can show': lambda: (
        scene(spheres=[sphere(material=CHECKS)])
    ),
    'spheres[1].name = "ball": taken by spheres[0]; names are unique': lambda: scene(
        spheres=[BALL, BALL]
    ),
    "spheres[0] = Plane('floor', normal=(0.0, 1.0, 0.0), offset=1.0, material='checks'): "
    "expected a Sphere": lambda: scene(spheres=[FLOOR]),
    "lights[0] = Sphere('ball', center=(0.0, 0.0, 0.0), radius=0.5, material='red'): "
    "expected a PointLight or a DirectionalLight": lambda: scene(lights=[BALL]),
    "lights = 5: expected a list, each a PointLight or a DirectionalLight": lambda: scene(lights=5),
    "spheres = Sphere('ball', center=(0.0, 0.0, 0.0), radius=0.5, material='red'): "
    "expected a list, each a Sphere": lambda: scene(spheres=BALL),
    "spheres[0] = 5: expected a Sphere": lambda: scene(spheres=[5]),
    "camera = 5: expected a Camera": lambda: wt.Scene(5),
    "camera = None: expected a Camera\nspheres = None: expected a list, each a Sphere": lambda: (
        wt.Scene(None, spheres=None)
    ),
    "camera: missing; expected a Camera\nsphere: unknown key; did you mean 'spheres'?": lambda: (
        wt.Scene(sphere=[BALL])
    ),
    "shapes: unknown key; did you mean 'spheres'?": lambda: scene(shapes=[BALL]),
    f"max_depth = 0: {DEPTH}": lambda: scene(max_depth=0),
    "materials.red: two different materials have this name": lambda: scene(
        materials=[wt.Material("red")]
    ),
    "materials.blue: the material's own name is 'red'": lambda: scene(materials={"blue": RED}),
    "materials[0] = 5: expected a Material": lambda: scene(materials=[5]),
    "materials = 5: expected a list, each a Material": lambda: scene(materials=5),
    "fog: unknown key; known are camera, spheres, planes, discs, clouds, lights, materials, "
    "background, ambient, max_depth, min_importance, precision": lambda: scene(fog=1),
    # Else materials.checks.checker.color would be the name of two parameters
    'materials."checks.checker": taken by materials.checks.checker; names are unique': lambda: (
        scene(materials=[RED, CHECKS, wt.Material("checks.checker")])
    ),
    'materials."red.checker": taken by materials.red.checker; names are unique': lambda: (
        scene()
        .add(wt.Material("red.checker"))
        .remove("ball")
        .replace({"materials.red.checker": wt.Checkerboard(color=(1, 0, 0), size=2)})
    ),
    # Of dictionaries
    "expected the tables of a scene, got 5": lambda: wt.Scene.from_dict(5),
    "[1]: unknown key": lambda: wt.Scene.from_dict({1: 2, "camera": scene().to_dict()["camera"]}),
    f"materials[5] = 5: {NAME}": lambda: wt.Scene.from_dict(
        {"materials": {5: {}}, "camera": scene().to_dict()["camera"]}
    ),
    "camera: missing; expected a table": lambda: wt.Scene.from_dict({}),
    "ambiant: unknown key; did you mean 'ambient'?": lambda: wt.Scene.from_dict(
        {**scene().to_dict(), "ambiant": 1}
    ),
    # Of text
    "text:1:8: not valid TOML: Expected ']' at the end of a table declaration": lambda: (
        wt.parse_scene("[camera\n")
    ),
    "camera = 5: expected a table": lambda: wt.parse_scene("camera = 5"),
    # Of changes
    "spheres.a.material = \"rad\": there is no such material; did you mean 'red'?": lambda: (
        scene().add(sphere(material="rad"))
    ),
    'spheres.ball.name = "ball": taken by spheres.ball; names are unique': lambda: scene().add(
        BALL
    ),
    "materials.red: taken; names are unique": lambda: scene().add(RED),
    "materials.red: two different materials have this name ": lambda: scene().add(
        sphere(material=wt.Material("red"))
    ),
    "materials.red: still in use, by spheres.ball; "
    "remove those as well, or first give them another material": lambda: scene().remove("red"),
    f"spheres.ball.material = None: {MATERIAL}": lambda: scene().replace(
        {"spheres.ball.material": None}
    ),
    "spheres.ball.material = \"rad\": there is no such material; did you mean 'red'?": lambda: (
        scene().replace({"spheres.ball.material": "rad"})
    ),
    "materials.checks: two different materials have this name": lambda: scene().replace(
        {"spheres.ball.material": wt.Material("checks")}
    ),
    f"camera.resolution = [0, 4]: {RESOLUTION}": lambda: scene().replace(
        {"camera.resolution": (0, 4)}
    ),
    f"camera.up = [0, 0, 1]: {ASKEW} ": lambda: scene().replace({"camera.up": (0, 0, 1)}),
    f"max_depth = 2.5: {DEPTH}": lambda: scene().replace({"max_depth": 2.5}),
    "min_importance = 2: expected a number in [0, 1]": lambda: scene().replace(
        {"min_importance": 2}
    ),
    "lights.key.falloff = \"cubic\": expected 'none' or 'inverse-square'": lambda: scene().replace(
        {"lights.key.falloff": "cubic"}
    ),
    "camera = 5: expected a Camera ": lambda: scene().replace({"camera": 5}),
    "lights.key = Material('red', color=(0.8, 0.2, 0.1)): expected a PointLight or a "
    "DirectionalLight": lambda: scene().replace({"lights.key": RED}),
    "spheres.ball: the new one's own name is 'a'; add it, and remove 'ball'": lambda: (
        scene().replace({"spheres.ball": sphere()})
    ),
    "materials.checks.checker.size: missing; expected a number > 0": lambda: scene().replace(
        {"materials.checks.checker": {"color": (1, 1, 1)}}
    ),
}


@pytest.mark.parametrize("message", PROBLEMS)
def test_problem_is_told_at_the_call_in_the_words_of_files(message):
    with pytest.raises(wt.SceneError) as error:
        PROBLEMS[message]()
    assert sorted(str(error.value).split("\n")) == sorted(message.strip().split("\n"))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: wt.Sphere("a", "red"), "Sphere: all arguments but the name are given by keyword"),
        (lambda: wt.Camera((0, 0, 3)), "Camera: all arguments are given by keyword"),
        (lambda: wt.Material("a", name="b"), "Material: all arguments but the name are given by"),
        (lambda: scene().replace(5), "replace: expected a dictionary, as in .*, got a int"),
        (lambda: scene().replace([("max_depth", 3)]), "replace: expected a dictionary, .* a list"),
        (
            lambda: scene().parameters(["ambient"]),
            "expected a name, .* got a list; parameters takes",
        ),
        (lambda: wt.gradient(scene(), ["camera.fov"]), "expected a name, .* got a list"),
        (lambda: wt.parse_scene(b""), "text: expected a string, got a bytes; load_scene reads a"),
        (lambda: scene().add(5), "add: expected a shape, a light or a material, got a int"),
        (lambda: scene().add(CAMERA), "add: expected a shape, a light or a material, got a Camera"),
    ],
)
def test_wrong_kinds_of_arguments_are_refused(call, message):
    with pytest.raises(TypeError, match=message):
        call()


@pytest.mark.parametrize(
    "call",
    [lambda: scene(precision="half"), lambda: scene().astype("half")]
    + [lambda: wt.parse_scene("", "half"), lambda: wt.Scene.from_dict({}, "half")],
)
def test_precision_is_checked(call):
    with pytest.raises(ValueError, match=r"^precision: expected 'single' or 'double', got 'half'$"):
        call()


def test_a_description_does_not_change():
    with pytest.raises(AttributeError, match=r"^radius: a Sphere does not change; make a new one$"):
        BALL.radius = 2


def test_descriptions_are_equal_by_their_values():
    assert sphere(radius=np.float64(1)) == sphere(radius=1) != sphere(radius=2)
    assert len({sphere(), sphere(radius=ad.Float64(1)), sphere(material=RED)}) == 2
    assert wt.Sphere(center=(0, 0, 0), radius=1, material="m") != BALL
    assert repr(wt.Material("m", fresnel=True)) == "Material('m', fresnel=True)"
    assert pickle.loads(pickle.dumps(FLOOR)) == copy.deepcopy(FLOOR) == FLOOR


def test_things_without_a_name_are_named_as_in_files():
    ball = wt.Sphere(center=(0, 0, 0), radius=1, material="red")
    made = scene(spheres=[BALL, ball, ball], materials=[RED])
    assert [shape.name for shape in made.shapes] == ["ball", "sphere1", "sphere2", "floor"]
    # A name that is taken is passed over
    more = made.remove("sphere1").add(ball, wt.Plane(normal=(0, 0, 1), offset=1, material="red"))
    assert [shape.name for shape in more.shapes] == [
        *("ball", "sphere2", "sphere3", "floor", "plane1")
    ]


def test_materials_may_be_given_in_any_way():
    by_name = wt.Sphere("ball", center=(0, 0, 0), radius=0.5, material="red")
    table = {"red": {"color": [0.8, 0.2, 0.1]}}
    for materials in ([RED], {"red": RED}, table, [RED, RED]):
        assert scene(spheres=[by_name], materials=materials) == scene()
    # The same material may be made again, also in the precision of a scene that has it
    again = wt.Material("red", color=(0.8, 0.2, 0.1))
    assert scene(materials=[again]) == scene().remove("ball").add(
        wt.Sphere("ball", center=(0, 0, 0), radius=0.5, material=again)
    )


def test_add_and_remove_make_new_scenes():
    small = wt.Scene(CAMERA)
    assert small.add(BALL).add(FLOOR, KEY).to_dict() == scene().to_dict()
    assert small == wt.Scene(CAMERA)
    left = scene().remove("ball", "planes.floor", "lights.key")
    assert left == wt.Scene(CAMERA, materials=[RED, CHECKS])
    assert left.remove("red", "materials.checks") == small
    assert scene().add(wt.Material("blue")).remove("blue") == scene()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("bal", "the scene has nothing called 'bal'; nearest: ball"),
        ("zzz", "the scene has nothing called 'zzz'; nearest: spheres.ball, spheres.key, planes"),
        ("key", "'key' may be spheres.key or lights.key; give one of these"),
        (3, r"expected the name of a thing, as in remove\('ball'\), got 3"),
    ],
)
def test_remove_tells_what_it_does_not_find(name, message):
    made = scene().add(wt.Sphere("key", center=(0, 0, 0), radius=1, material="red"))
    with pytest.raises(KeyError, match=message):
        made.remove(name)
    with pytest.raises(KeyError, match="'a'; it is empty"):
        wt.Scene(CAMERA).remove("a")


def test_replace_takes_what_no_gradient_can_change():
    board = wt.Checkerboard(color=(1, 0, 0), size=2)
    changes = {
        "planes.floor.material": "red",
        "camera.resolution": np.array([16, 12]),
        "camera.up": (1, 0, 0),
        "max_depth": 3,
        "min_importance": 0.25,
        "materials.red.fresnel": True,
        "materials.red.ior": 1.75,
        "materials.checks.checker": None,
        "lights.key.falloff": "inverse-square",
        "spheres.ball.radius": 0.25,
    }
    red = wt.Material("red", color=(0.8, 0.2, 0.1), fresnel=True, ior=1.75)
    expected = wt.Scene(
        wt.Camera(position=(0, 0, 3), look_at=(0, 0, 0), fov=50, resolution=(16, 12), up=(1, 0, 0)),
        spheres=[wt.Sphere("ball", center=(0, 0, 0), radius=0.25, material=red)],
        planes=[wt.Plane("floor", normal=(0, 1, 0), offset=1, material=red)],
        lights=[
            wt.PointLight("key", position=(1, 3, 2), intensity=(1, 1, 1), falloff="inverse-square")
        ],
        materials=[wt.Material("checks")],
        max_depth=3,
        min_importance=0.25,
    )
    changed = scene().replace(changes)
    assert changed.to_dict() == expected.to_dict()
    # New materials and boards
    green = wt.Material("green", checker=board)
    floor = wt.Plane("floor", normal=(0, 1, 0), offset=1, material=green)
    assert (
        scene().replace({"planes.floor.material": green}).to_dict()
        == scene(planes=[floor], materials=[RED, CHECKS]).to_dict()
    )
    rebuilt = scene().replace({"materials.checks.checker": board})
    assert rebuilt.numbers["materials.checks.checker.size"] == (2,)


def test_replace_takes_things_as_a_whole():
    green = wt.Material("green", color=(0, 1, 0))
    camera = wt.Camera(
        position=(0, 0, 4), look_at=(0, 0, 0), fov=40, resolution=(8, 8), up=(1, 0, 0)
    )
    ball = wt.Sphere(center=(1, 0, 0), radius=0.25, material=green)
    sun = wt.DirectionalLight("key", direction=(0, -1, 0), irradiance=(1, 1, 1))
    red = wt.Material("red", reflection=0.5)
    changed = scene().replace(
        {"camera": camera, "spheres.ball": ball, "lights.key": sun, "materials.red": red}
    )
    named = wt.Sphere("ball", center=(1, 0, 0), radius=0.25, material="green")
    expected = wt.Scene(
        camera,
        spheres=[named],
        planes=[FLOOR],
        lights=[sun],
        materials=[red, CHECKS, green],
    )
    assert changed == expected
    # A parameter in the same call counts as well, and what stays keeps its gradient
    values = scene().parameters("camera.fov", "planes.floor.offset")
    dr.enable_grad(values)
    moved = scene().replace(values).replace({"camera": camera, "camera.fov": 30})
    kept = moved.parameters(*values)
    assert moved.numbers["camera.fov"] == (30,)
    assert [dr.grad_enabled(kept[name]) for name in values] == [False, True]


def test_replace_of_settings_keeps_gradients():
    values = scene().parameters("spheres.ball.radius", "materials.red.color")
    dr.enable_grad(values)
    carrying = scene().replace(values)
    for changed in (
        carrying.replace({"camera.up": (1, 0, 0), "background": (1, 1, 1)}),
        carrying.add(wt.Sphere(center=(1, 1, 1), radius=1, material="red")).remove("floor"),
        carrying.astype("double"),
    ):
        kept = changed.parameters(*values)
        assert all(dr.grad_enabled(value) for value in kept.values())
        # What an optimiser moves stays compiled
        assert "materials.red.color" in changed.touched
        dr.backward(kept["spheres.ball.radius"] * 3)
    assert values["spheres.ball.radius"].grad == 9


def test_replace_refuses_unknown_names_with_the_nearest():
    message = "the scene has no parameter 'spheres.ball.materiel'; nearest: spheres.ball.material"
    with pytest.raises(KeyError, match=message):
        scene().replace({"spheres.ball.materiel": "red", "spheres.ball.radius": 1})
    with pytest.raises(KeyError, match="the scene has no parameter 'max_deph'; nearest: max_depth"):
        scene().replace({"max_deph": 1})


@pytest.mark.parametrize(
    ("patterns", "names"),
    [
        (["spheres.*.center"], ["spheres.ball.center", "spheres.b.c.center"]),
        (["*.color"], [f"materials.{name}.color" for name in ("red", "checks", "checks.checker")]),
        (["spheres.b*.radius"], ["spheres.ball.radius", "spheres.b.c.radius"]),
        (["ambient", "lights.*"], ["ambient", "lights.key.position", "lights.key.intensity"]),
        (["camera.fov", "camera.f*"], ["camera.fov"]),
    ],
)
def test_a_star_stands_for_any_part_of_a_name(patterns, names):
    made = scene().add(wt.Sphere("b.c", center=(0, 0, 0), radius=1, material="red"))
    assert list(made.parameters(*patterns)) == names
    assert len(made.parameters("*")) == len(made.parameters())


def test_a_star_may_be_a_name():
    made = scene().add(wt.Sphere("*", center=(1, 0, 0), radius=1, material="red"))
    assert list(made.parameters("spheres.*.radius")) == ["spheres.*.radius"]


def test_a_pattern_that_nothing_matches_is_refused():
    message = r"the scene has no parameter 'spheres\.\*\.centre'; nearest: spheres.ball.center"
    with pytest.raises(KeyError, match=message):
        scene().parameters("spheres.*.centre")


def test_equality_is_that_of_things_numbers_and_precision():
    same = scene()
    assert same == scene()
    assert hash(same) == hash(scene())
    assert same == same.replace({"spheres.ball.radius": 0.5})
    for other in (
        same.replace({"spheres.ball.radius": np.nextafter(np.float32(0.5), np.float32(1))}),
        same.replace({"materials.red.reflection": 1e-7}),
        same.replace({"max_depth": 4}),
        same.replace({"camera.resolution": (4, 4)}),
        same.replace({"lights.key.falloff": "inverse-square"}),
        same.replace({"planes.floor.material": "red"}),
        same.add(wt.Material("blue")),
        same.astype("double"),
        same.to_dict(),
    ):
        assert same != other


def test_precision_may_be_changed():
    double = scene().astype("double")
    assert (double.precision.name, double.background.__class__) == ("double", ad.Array3f64)
    assert double.numbers == scene().numbers
    assert double.astype("single") == scene()
    assert scene(precision="double").astype("single") == scene()


@pytest.mark.parametrize("file", SHIPPED, ids=lambda path: path.stem)
def test_shipped_scenes_have_names(file):
    assert wt.load_scene(file.stem) == wt.load_scene(file)


def test_unknown_shipped_scene_is_refused_with_the_nearest(tmp_path, monkeypatch):
    with pytest.raises(
        wt.SceneError,
        match=r"^cornel: there is no such file, and no shipped scene of this name; nearest: cornel",
    ):
        wt.load_scene("cornel")
    with pytest.raises(wt.SceneError, match="nearest: cornell, cornell_two_lights, glass_pair, "):
        wt.load_scene("xyzxyzxyz")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        wt.SceneError, match=r"No such file .*; the shipped scene is called 'table'$"
    ):
        wt.load_scene("scenes/table.toml")
    # A file goes before a shipped scene, a folder does not
    (tmp_path / "table").mkdir()
    assert len(wt.load_scene("table").shapes) > 1
    (tmp_path / "cornell").write_text(samples.camera([0, 0, 3]))
    assert wt.load_scene("cornell").shapes == ()


def check_round_trips(made):
    precision = made.precision.name
    again = wt.Scene.from_dict(made.to_dict(), precision)
    assert again == made
    assert again.to_dict() == made.to_dict()
    assert pickle.loads(pickle.dumps(made)) == made == copy.copy(made) == copy.deepcopy(made)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_of_all_kinds_survive_a_dictionary(name):
    check_round_trips(wt.parse_scene(SCENES[name]))


@given(
    scenes(LAYOUTS["mixed"], generic=False),
    st.sampled_from(["single", "double"]),
    st.sampled_from(sorted(FORMS)),
)
def test_any_scene_made_in_python_is_that_of_its_file(numbers, precision, form):
    layout, (number, vector) = LAYOUTS["mixed"], FORMS[form]

    def of(path):
        return {
            key[len(path) + 1 :]: vector(value) if np.ndim(value) else number(value)
            for key, value in numbers.items()
            if key.startswith(f"{path}.")
        }

    materials = [
        wt.Material(f"m{i}", fresnel=fresnel, **of(f"materials.m{i}"))
        for i, fresnel in enumerate(layout.materials)
    ]
    spheres, planes = range(layout.spheres), range(layout.planes)
    made = wt.Scene(
        wt.Camera(**of("camera"), resolution=(24, 24), up=UP),
        spheres=[wt.Sphere(material=materials[i], **of(f"spheres.sphere{i}")) for i in spheres],
        planes=[
            wt.Plane(material=materials[layout.spheres + i], **of(f"planes.plane{i}"))
            for i in planes
        ],
        lights=[
            wt.PointLight(falloff=layout.falloff(i), **of(f"lights.light{i}"))
            for i in range(layout.lights)
        ],
        background=numbers["background"],
        ambient=numbers["ambient"],
        precision=precision,
    )
    assert made == wt.parse_scene(layout.text(numbers), precision)
    check_round_trips(made)


def test_summary_is_short():
    text = repr(scene())
    assert text == str(scene())
    assert text.splitlines() == [
        "Scene, 8 x 4 pixels, depth 5, single precision",
        "camera                 position 0 0 3  look_at 0 0 0  fov 50",
        "sphere  ball   red     center 0 0 0  radius 0.5",
        "plane   floor  checks  normal 0 1 0  offset 1",
        "light   key            position 1 3 2  intensity 1 1 1",
    ]
    many = scene().add(
        *(
            wt.Sphere(f"{i}" * 40, center=(-1.2345e-7,) * 3, radius=1, material="red")
            for i in range(1, 40)
        )
    )
    assert repr(many).endswith("and 30 more")
    assert len(repr(many)) < 2000


NO_SCENES = {
    "scene: expected a Scene, got 'cornell'; load one with whitted.load_scene('cornell')": (
        lambda: wt.render("cornell"),
        lambda: wt.render(Path("cornell"), error=0.1),
        lambda: wt.gradient("cornell", "spheres.ball.center", "x"),
        lambda: wt.fit("cornell", np.zeros((4, 4, 3)), wrt="spheres.ball.center"),
        lambda: wt.torch_render("cornell", {}),
    ),
    "scene: expected a Scene, got a NoneType; load one with whitted.load_scene('cornell')": (
        lambda: wt.render(None),
        lambda: wt.fit(None, wrt="spheres.ball.center"),
    ),
}


@pytest.mark.parametrize("message", NO_SCENES)
def test_what_is_no_scene_is_told_how_to_become_one(message):
    for call in NO_SCENES[message]:
        with pytest.raises(TypeError) as caught:
            call()
        assert str(caught.value) == message
