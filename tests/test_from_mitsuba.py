"""Scenes of Mitsuba 3: what is taken, what is refused, and that both renderers see the same."""

import math
import re
import sys
from contextlib import nullcontext

import drjit as dr
import numpy as np
import pytest
from mitsuba_pictures import NEEDED, compare, picture

import whitted as wt

TURNED = np.array([[-1.0, 0, 0, 0.1], [0, 1, 0, 0.4], [0, 0, -1, 3], [0, 0, 0, 1]])
FILM = {"type": "hdrfilm", "width": 12, "height": 8, "rfilter": {"type": "box"}}
SENSOR = {"type": "perspective", "fov": 40, "to_world": TURNED, "film": FILM}
RED = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.8, 0.2, 0.1]}}
SHEAR = np.array([[1, 0.5, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def scene(integrator=None, sensor=None, **things):
    """A scene of Mitsuba, without anything that warns."""
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2, **(integrator or {})},
        "sensor": SENSOR | (sensor or {}),
        **things,
    }


def ball(**keys):
    return {"type": "sphere", **keys}


def taken(found, **values):
    """Whether a scene has these numbers, by the names of parameters with "__" for dots."""
    for name, value in values.items():
        got = found.numbers[name.replace("__", ".")]
        np.testing.assert_allclose(got, np.ravel(value), rtol=1e-12, atol=1e-12, err_msg=name)
    return True


# What is taken, exactly


def test_a_scene_of_the_example_in_mitsubas_words():
    found = wt.from_mitsuba(
        scene(
            {"max_depth": 6, "rr_depth": 9},
            red=RED,
            ball=ball(center=[1, 2, 3], radius=0.5, bsdf={"type": "ref", "id": "red"}),
            key={"type": "point", "position": [1, 2, 4], "intensity": {"type": "rgb", "value": 2}},
        ),
        "double",
    )
    assert taken(
        found,
        spheres__ball__center=[1, 2, 3],
        spheres__ball__radius=0.5,
        materials__red__color=[0.8, 0.2, 0.1],
        lights__key__position=[1, 2, 4],
        lights__key__intensity=[2 / math.pi] * 3,
        camera__position=[0.1, 0.4, 3],
        camera__look_at=[0.1, 0.4, 2],
        background=[0, 0, 0],
    )
    assert found.lights[0].falloff == "inverse-square"
    assert (found.resolution, found.max_depth) == ((12, 8), 5)
    assert found.camera.up == (0, 1, 0)
    assert found.precision.name == "double"


@pytest.mark.parametrize(
    ("axis", "across"),
    [("x", 12), ("y", 8), ("smaller", 8), ("larger", 12), ("diagonal", math.hypot(12, 8))],
)
def test_the_field_of_view_along_any_axis(axis, across):
    found = wt.from_mitsuba(scene(sensor={"fov_axis": axis}), "double")
    half = math.atan(math.tan(math.radians(20)) * 8 / across)
    assert taken(found, camera__fov=2 * math.degrees(half))


def test_the_focal_length():
    """50 mm is Mitsuba's default, for film of 36 x 24 mm, and for other shapes by the diagonal."""
    sensor = {key: value for key, value in SENSOR.items() if key != "fov"}
    film = FILM | {"width": 36, "height": 24}
    for more in ({}, {"focal_length": "50mm"}):
        found = wt.from_mitsuba({"type": "scene", "sensor": {**sensor, **more, "film": film}})
        assert math.isclose(
            found.numbers["camera.fov"][0], 2 * math.degrees(math.atan(0.24)), rel_tol=1e-6
        )


def test_numbers_of_any_kind():
    """Python's, NumPy's, Dr.Jit's; transforms as arrays, as matrices, and as what holds one."""

    class Transform:
        matrix = dr.scalar.Matrix4f64(TURNED)

    for number, vector, transform in [
        (0.5, (1, 2, 3), TURNED.tolist()),
        (np.float32(0.5), np.array([1, 2, 3]), TURNED.astype(np.float32)),
        (dr.llvm.ad.Float(0.5), dr.llvm.ad.Array3f(1, 2, 3), Transform.matrix),
        (np.array([0.5]), dr.scalar.Array3f(1, 2, 3), Transform()),
    ]:
        found = wt.from_mitsuba(
            scene(
                sensor={"to_world": transform},
                ball=ball(
                    center=vector, radius=number, m={"type": "diffuse", "reflectance": number}
                ),
            )
        )
        assert found.numbers["spheres.ball.center"] == (1, 2, 3)
        assert found.numbers["spheres.ball.radius"] == (0.5,)
        assert found.numbers["materials.ball.color"] == (0.5, 0.5, 0.5)
        np.testing.assert_allclose(found.numbers["camera.position"], [0.1, 0.4, 3], rtol=1e-6)


def test_spheres_move_with_their_transform():
    turn = np.array([[0, -2, 0, 1], [2, 0, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1.0]])
    found = wt.from_mitsuba(scene(ball=ball(center=[1, 0, 0], radius=0.5, to_world=turn)), "double")
    assert taken(found, spheres__ball__center=[1, 4, 3], spheres__ball__radius=1)


def test_disks_are_discs():
    turn = np.array([[0, 0, 2, 1], [2, 0, 0, 2], [0, 2, 0, 3], [0, 0, 0, 1.0]])
    for flipped, sign in ((False, 1), (True, -1)):
        disk = {"type": "disk", "to_world": turn, "flip_normals": flipped}
        found = wt.from_mitsuba(scene(disk={**disk, "m": {"type": "twosided", "m": RED}}), "double")
        assert taken(
            found,
            discs__disk__center=[1, 2, 3],
            discs__disk__radius=2,
            discs__disk__normal=[sign, 0, 0],
        )


def test_directional_lights():
    direct = {"type": "directional", "direction": [0, -2, 0], "irradiance": 3.0}
    turned = {"type": "directional", "to_world": TURNED}
    found = wt.from_mitsuba(scene(a=direct, b=turned), "double")
    assert taken(
        found,
        lights__a__direction=[0, -1, 0],
        lights__a__irradiance=[3 / math.pi] * 3,
        lights__b__direction=[0, 0, -1],
        lights__b__irradiance=[1 / math.pi] * 3,
    )


def test_glass_and_mirrors():
    glass = {"type": "dielectric", "int_ior": "diamond", "ext_ior": 1.2}
    grey = {
        "specular_reflectance": 0.5,
        "specular_transmittance": {"type": "spectrum", "value": 0.7},
    }
    found = wt.from_mitsuba(
        scene(
            a=ball(center=[-3, 0, 0], bsdf=glass | grey),
            b=ball(m={"type": "conductor", "material": "none", "specular_reflectance": 0.6}),
            c=ball(center=[3, 0, 0], bsdf={"type": "dielectric"}),
            d=ball(center=[6, 0, 0]),
        ),
        "double",
    )
    assert taken(
        found,
        materials__a__ior=2.419 / 1.2,
        materials__a__reflection=0.5,
        materials__a__refraction=0.7,
        materials__b__reflection=0.6,
        materials__b__refraction=0,
        materials__c__ior=1.5046 / 1.000277,
        materials__c__reflection=1,
        materials__default__color=[0.5] * 3,
    )
    assert [own.fresnel for own in found.materials] == [True, False, True, False]


def test_glass_in_glass():
    """Indices are those of an interface in Mitsuba, and of a medium here."""
    found = wt.from_mitsuba(
        scene(
            {"max_depth": 9},
            water=ball(radius=1, m={"type": "dielectric", "int_ior": 1.33, "ext_ior": 1}),
            air=ball(radius=0.5, m={"type": "dielectric", "int_ior": 1, "ext_ior": 1.33}),
            odd=ball(radius=0.2, m={"type": "dielectric", "int_ior": 3, "ext_ior": 2}),
        ),
        "double",
    )
    iors = {
        f"materials__{name}__ior": ior for name, ior in (("water", 1.33), ("air", 1), ("odd", 1.5))
    }
    assert taken(found, **iors)


@pytest.mark.parametrize(
    ("integrator", "depth"),
    [
        ({"max_depth": 2}, 1),
        ({"max_depth": 7}, 6),
        ({"type": "direct"}, 1),
        ({"type": "prb", "max_depth": 4}, 3),
        ({"type": "prb_projective", "max_depth": 4, "sppi": 32}, 3),
    ],
)
def test_depths(integrator, depth):
    own = {"type": "path", **integrator}
    if own["type"] == "direct":
        own.pop("max_depth", None)
    found = wt.from_mitsuba({**scene(), "integrator": own, "m": ball(m={"type": "conductor"})})
    assert found.max_depth == depth


def test_an_endless_path_between_matte_surfaces_is_one_node():
    found = wt.from_mitsuba({"type": "scene", "sensor": SENSOR, "ball": ball(m=RED)})
    assert found.max_depth == 1


def test_a_sky_over_mirrors():
    """All light is the sky: a chain of n nodes sees it over n segments."""
    found = wt.from_mitsuba(
        scene(
            {"max_depth": 4},
            m=ball(m={"type": "conductor"}),
            sky={"type": "constant", "radiance": 0.5},
        ),
        "double",
    )
    assert taken(found, background=[0.5] * 3)
    assert found.max_depth == 4


def walls(size, **bsdf):
    """Six rectangles that close a cube around the origin, with their normals inward."""
    found = {}
    for axis in range(3):
        for sign in (-1, 1):
            normal, u, v = -sign * np.eye(3)[axis], *np.roll(np.eye(3), 2 - axis, 0)[:2] * size
            turn = np.eye(4)
            turn[:3] = np.array(
                [u, v * (np.cross(u, v) @ normal) / size**2, normal, -size * normal]
            ).T
            found[f"wall{len(found)}"] = {"type": "rectangle", "to_world": turn, **bsdf}
    return found


def test_rectangles_that_close_a_room_are_planes():
    room = walls(5, bsdf=RED)
    found = wt.from_mitsuba(scene(**room), "double")
    assert len(found.shapes) == 6
    assert taken(found, planes__wall0__normal=[1, 0, 0], planes__wall0__offset=5)
    del room["wall3"]
    with pytest.raises(
        wt.SceneError,
        match=r"^wall0: a rectangle has no counterpart, unless all rectangles close a room",
    ):
        wt.from_mitsuba(scene(**room))


def test_a_lamp_outside_opens_a_room():
    lamp = {"type": "point", "position": [0, 6, 0]}
    with pytest.raises(wt.SceneError, match="a rectangle has no counterpart"):
        wt.from_mitsuba(scene(lamp=lamp, **walls(5, bsdf=RED)))


def test_names_of_materials():
    """A nested BSDF has its own id, or the name of its shape; one that is taken gets a number."""
    found = wt.from_mitsuba(
        scene(
            a=ball(bsdf=RED | {"id": "red"}),
            b=ball(bsdf=RED),
            c=ball(id="cc", bsdf={"type": "twosided", "id": "b", "inner": {"type": "diffuse"}}),
            d=ball(bsdf={"type": "ref", "id": "red"}),
        )
    )
    assert [(own.name, own.material) for own in found.shapes] == [
        ("a", "red"),
        ("b", "b"),
        ("cc", "b2"),
        ("d", "red"),
    ]


# What is refused

GLASS = {"type": "dielectric"}
ROUGH = "rough surfaces have no counterpart; with approximate=True a smooth one is taken"


def unlike(what, expected):
    return f"this {what} has no counterpart here; expected {expected}"


BSDFS = "'diffuse', 'twosided', 'dielectric', 'conductor', 'roughdielectric' or 'roughconductor'"
TURN = "expected a rotation and a translation: no scale, no shear, no mirroring"
PLANES = "expected square cells along the world's axes from the origin on, on a rectangle"
BOARD = {"type": "diffuse", "reflectance": {"type": "checkerboard"}}
FLAT_BOARD = {
    "type": "diffuse",
    "reflectance": BOARD["reflectance"] | {"to_uv": np.diag([0, 0, 1])},
}
PROBLEMS = [
    # Plugins
    (
        {"ball": {"type": "spere"}},
        "ball.type = \"spere\": there is no such plugin of Mitsuba; did you mean 'sphere'?",
    ),
    (
        {"mesh": {"type": "obj"}},
        'mesh.type = "obj": ' + unlike("shape", "'sphere', 'rectangle' or 'disk'"),
    ),
    (
        {"lamp": {"type": "area"}},
        'lamp.type = "area": ' + unlike("emitter", "'point', 'directional' or 'constant'"),
    ),
    ({"b": ball(m={"type": "plastic"})}, 'b.m.type = "plastic": ' + unlike("bsdf", BSDFS)),
    ({"b": ball(m={"type": "mask", "m": RED})}, 'b.m.type = "mask": ' + unlike("bsdf", BSDFS)),
    (
        {"fog": {"type": "homogeneous"}},
        "fog.type = \"homogeneous\": 'homogeneous' in 'scene' has no counterpart here",
    ),
    (
        {"b": ball(lamp={"type": "area"})},
        "b.lamp.type = \"area\": 'area' in 'sphere' has no counterpart here",
    ),
    ({"b": ball(m={"color": 3})}, "b.m.type: missing; expected the name of a plugin"),
    ({"b": ball(m=object())}, "b.m: expected a dictionary, got an object of the type object"),
    (
        {"b": ball(m={"type": "ref", "id": "rde"}), "red": RED},
        "b.m.id = \"rde\": there is no such object; did you mean 'red'?",
    ),
    ({"b": ball(m={"type": "ref", "id": "c"}), "c": ball()}, "b.m: 'c' has no place in 'sphere'"),
    ({"b": ball(m=RED, n=RED)}, "b.n: a second bsdf; expected one"),
    # Parameters
    ({"b": ball(raduis=1)}, "b.raduis: unknown parameter of 'sphere'; did you mean 'radius'?"),
    ({"b": ball(radius=-1)}, "b.radius = -1: expected a number > 0"),
    ({"b": ball(radius=True)}, "b.radius = true: expected a number > 0"),
    ({"b": ball(center=[0, math.nan, 0])}, "b.center = [0, NaN, 0]: expected three finite numbers"),
    ({"b": ball(flip_normals=True)}, "b.flip_normals = true: has no counterpart; expected False"),
    ({"b": ball(flip_normals=1)}, "b.flip_normals = 1: expected True or False"),
    (
        {"b": ball(to_world=np.diag([2, 1, 1, 1]))},
        "b.to_world = [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]: "
        "expected the same scale along all axes, and no shear",
    ),
    ({"b": ball(to_world=3)}, "b.to_world = 3: expected an affine transform, a 4 x 4 matrix"),
    (
        {"b": {"type": "rectangle", "to_world": SHEAR}},
        "b.to_world = [[1.0, 0.5, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1...: "
        "expected a transform that can be inverted, without shear",
    ),
    (
        {"b": {"type": "disk", "to_world": np.diag([2, 1, 1, 1])}},
        "b.to_world = [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]: "
        "expected the same scale along both axes of a disk",
    ),
    (
        {"b": {"type": "disk", "m": GLASS}},
        "b: glass without a volume has no counterpart; expected a sphere",
    ),
    # Colours
    (
        {"b": ball(m=RED | {"reflectance": [2, 0, 0]})},
        "b.m.reflectance = [2, 0, 0]: expected linear RGB, three numbers in [0, 1]",
    ),
    (
        {"a": {"type": "point", "intensity": [-1, 0, 0]}},
        "a.intensity = [-1, 0, 0]: expected linear RGB, three numbers >= 0",
    ),
    (
        {"a": {"type": "point", "intensity": {"type": "spectrum", "value": 2.0}}},
        "a.intensity.type = \"spectrum\": spectra have no counterpart; expected 'rgb'",
    ),
    (
        {"a": {"type": "point", "intensity": {"type": "d65"}}},
        "a.intensity.type = \"d65\": this has no counterpart here; expected 'rgb'",
    ),
    (
        {"a": {"type": "point", "intensity": {"type": "rbg"}}},
        "a.intensity.type = \"rbg\": there is no such plugin of Mitsuba; did you mean 'rgb'?",
    ),
    (
        {"a": {"type": "point", "intensity": {"type": "rgb", "value": 1, "scale": 2}}},
        "a.intensity.scale: unknown parameter of 'rgb'",
    ),
    (
        {"b": ball(m={"type": "diffuse", "reflectance": {"type": "bitmap"}})},
        'b.m.reflectance.type = "bitmap": ' + unlike("texture", "'checkerboard'"),
    ),
    (
        {"b": {"type": "rectangle", "m": FLAT_BOARD}},
        'b.m.reflectance.type = "checkerboard": ' + PLANES,
    ),
    ({"b": ball(m=BOARD)}, 'b.m.reflectance.type = "checkerboard": ' + PLANES),
    # Materials
    (
        {"glass": ball(bsdf={"type": "roughdielectric", "alpha": 0.1})},
        f"glass.bsdf.alpha = 0.1: {ROUGH}",
    ),
    ({"glass": ball(bsdf={"type": "roughconductor"})}, f"glass.bsdf.alpha: {ROUGH}"),
    (
        {"b": ball(m={"type": "dielectric", "int_ior": "bk8"})},
        'b.m.int_ior = "bk8": expected an index of refraction, or the name of a medium; '
        "did you mean 'bk7'?",
    ),
    ({"b": ball(m={"type": "dielectric", "int_ior": 0})}, "b.m.int_ior = 0: expected a number > 0"),
    (
        {"b": ball(m={"type": "dielectric", "specular_transmittance": [1, 0.5, 0]})},
        "b.m.specular_transmittance = [1, 0.5, 0]: coloured weights have no counterpart; "
        "with approximate=True its mean is taken",
    ),
    (
        {"b": ball(m={"type": "conductor", "material": "Cu"})},
        "b.m.material = \"Cu\": metals have no counterpart; expected 'none', a mirror",
    ),
    (
        {"b": ball(m={"type": "conductor", "eta": 0.2})},
        "b.m.eta = 0.2: metals have no counterpart; expected none",
    ),
    ({"b": ball(m={"type": "twosided"})}, "b.m: 'twosided' without a material in it"),
    (
        {"b": ball(m={"type": "twosided", "m": GLASS})},
        "b.m: 'dielectric' has two sides, and cannot be in 'twosided'",
    ),
    (
        {"a": ball(m=GLASS), "b": ball(center=[1, 0, 0], m=GLASS)},
        "b: this glass overlaps with 'a'; "
        "with approximate=True the smaller of the two fills what both contain",
    ),
    # Lights
    (
        {"a": {"type": "point", "position": [1, 2]}},
        "a.position = [1, 2]: expected three finite numbers",
    ),
    (
        {"a": {"type": "point", "position": [1, 2, 3], "to_world": TURNED.tolist()}},
        "a.to_world: expected either this or position",
    ),
    (
        {"a": {"type": "directional", "direction": [0, 0, 0]}},
        "a.direction = [0, 0, 0]: expected a direction, not zero",
    ),
    (
        {"a": {"type": "directional", "direction": [0, 1, 0], "to_world": TURNED.tolist()}},
        "a.to_world: expected either this or direction",
    ),
    (
        {"a": {"type": "constant"}, "b": {"type": "constant"}},
        "b: a second constant emitter; expected one",
    ),
    (
        {"sky": {"type": "constant"}, "b": ball()},
        "sky: in Mitsuba the sky lights matte surfaces, and the background here does not; "
        "with approximate=True it is seen, and lights nothing",
    ),
    # Cameras
    (
        {"sensor": {"type": "thinlens"}},
        'sensor.type = "thinlens": ' + unlike("sensor", "'perspective'"),
    ),
    (
        {"other": SENSOR},
        "other: a second sensor; expected one; with approximate=True the first is taken",
    ),
    (
        {"sensor": SENSOR | {"fov": 180}},
        "sensor.fov = 180: expected an angle in degrees, in (0, 180)",
    ),
    (
        {"sensor": SENSOR | {"fov_axis": "z"}},
        "sensor.fov_axis = \"z\": expected 'x', 'y', 'diagonal', 'smaller' or 'larger'",
    ),
    (
        {"sensor": SENSOR | {"fov_axis": "large"}},
        "sensor.fov_axis = \"large\": expected 'x', 'y', 'diagonal', 'smaller' or 'larger'; "
        "did you mean 'larger'?",
    ),
    (
        {"sensor": SENSOR | {"focal_length": "50mm"}},
        "sensor.focal_length: expected either this or fov",
    ),
    (
        {"sensor": {"type": "perspective", "focal_length": "long", "film": FILM}},
        "sensor.focal_length = \"long\": expected a length such as '50mm'",
    ),
    (
        {"sensor": SENSOR | {"principal_point_offset_x": 0.1}},
        "sensor.principal_point_offset_x = 0.1: has no counterpart; expected 0",
    ),
    (
        {"sensor": SENSOR | {"to_world": np.diag([-1, 1, 1, 1])}},
        f"sensor.to_world = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]: {TURN}",
    ),
    (
        {"sensor": SENSOR | {"film": FILM | {"width": 8.5}}},
        "sensor.film.width = 8.5: expected a whole number >= 1",
    ),
    (
        {"sensor": SENSOR | {"film": FILM | {"crop_width": 3}}},
        "sensor.film.crop_width = 3: crops have no counterpart; expected 12",
    ),
    (
        {"sensor": SENSOR | {"film": {"type": "specfilm"}}},
        'sensor.film.type = "specfilm": ' + unlike("film", "'hdrfilm'"),
    ),
    # Integrators
    (
        {"integrator": {"type": "ptracer"}},
        'integrator.type = "ptracer": '
        + unlike(
            "integrator",
            "'path', 'direct', 'prb', 'prb_basic', 'prb_projective' or 'direct_projective'",
        ),
    ),
    (
        {"integrator": {"type": "path", "max_depth": 1}},
        "integrator.max_depth = 1: expected 2 or more: shorter paths see nothing but sources",
    ),
    (
        {"integrator": {"type": "path"}, "b": ball(m=GLASS)},
        "integrator.max_depth: paths without an end have no counterpart; expected a whole number; "
        "with approximate=True max_depth is 10 here",
    ),
    (
        {
            "integrator": {"type": "path", "max_depth": 2, "hide_emitters": True},
            "sky": {"type": "constant"},
        },
        "integrator.hide_emitters = true: the sky is seen here; expected False",
    ),
    (
        {"integrator": {"type": "path", "max_depth": 300}},
        "max_depth = 299: expected a whole number from 1 to 256",
    ),
]


@pytest.mark.parametrize(("things", "message"), PROBLEMS, ids=[text for _, text in PROBLEMS])
def test_what_has_no_counterpart_is_refused_by_its_path(things, message):
    with pytest.raises(wt.SceneError) as caught:
        wt.from_mitsuba({**scene(), **things})
    assert message in str(caught.value).splitlines()


def test_all_problems_are_listed():
    with pytest.raises(wt.SceneError) as caught:
        wt.from_mitsuba(
            {
                "type": "scene",
                "a": ball(radius=0, m={"type": "plastic"}),
                "b": {"type": "rectangle", "to_world": SHEAR},
            }
        )
    assert [line.split(":")[0].split(" =")[0] for line in str(caught.value).splitlines()] == [
        "a.m.type",
        "a.radius",
        "b.to_world",
        "sensor",
    ]


def test_a_problem_of_what_is_shared_is_told_once():
    with pytest.raises(wt.SceneError) as caught:
        wt.from_mitsuba(
            scene(
                m={"type": "plastic"},
                a=ball(m={"type": "ref", "id": "m"}),
                b=ball(m={"type": "ref", "id": "m"}),
            )
        )
    assert str(caught.value) == 'm.type = "plastic": ' + unlike("bsdf", BSDFS)


def test_other_sources():
    with pytest.raises(wt.SceneError, match=r"^type = \"sphere\": expected 'scene'$"):
        wt.from_mitsuba(ball())
    message = "^source: expected a dictionary of Mitsuba or the path of an XML file, got int$"
    with pytest.raises(TypeError, match=message):
        wt.from_mitsuba(3)
    with pytest.raises(ValueError, match=r"^precision: expected 'single' or 'double', got 'half'$"):
        wt.from_mitsuba(scene(), "half")


# What is taken with a warning

SEEN = "its back can be seen: it is black in Mitsuba, and like its front here"
WARNED = [
    (
        {"sensor": SENSOR | {"film": {"type": "hdrfilm"}}},
        "sensor.film.rfilter: Mitsuba blurs pixels by a 'gaussian' filter; "
        "here each is the mean of its square, as by 'box'",
    ),
    (
        {"sensor": SENSOR | {"film": FILM | {"rfilter": {"type": "tent"}}}},
        "sensor.film.rfilter: Mitsuba blurs pixels by a 'tent' filter; "
        "here each is the mean of its square, as by 'box'",
    ),
    (
        {"integrator": {"type": "path"}, "a": ball(), "b": ball(center=[3, 0, 0])},
        "integrator.max_depth: Mitsuba also follows light from one matte surface to another; "
        "this is darker without it",
    ),
    # A disk's back, which the eye sees, or a ball behind it; none is seen of what is all before it
    ({"a": {"type": "disk"}, "b": ball(m=GLASS, center=[0, 0, 1.1])}, None),
    ({"a": {"type": "disk"}, "b": {"type": "disk"}}, None),
    ({"a": {"type": "disk"}, "b": ball(m=GLASS, center=[0, 0, 0.9])}, f"a: {SEEN}"),
    ({"a": {"type": "disk", "flip_normals": True}}, f"a: {SEEN}"),
    ({"a": ball(center=[0, 0, 3])}, f"a: {SEEN}"),
    (
        {"a": ball(center=[0, 0, -2e4])},
        "a: Mitsuba may cut off parts of it, by sensor.far_clip; nothing is cut off here",
    ),
    (
        {"a": ball(m=GLASS, center=[0.1, 0.4, 1.995])},
        "a: Mitsuba may cut off parts of it, by sensor.near_clip; nothing is cut off here",
    ),
    (
        {"a": ball(m=GLASS, center=[0, 0, 3])},
        "a: the eye or a light is inside this glass: Mitsuba scales radiance "
        "there, whitted does not",
    ),
]


@pytest.mark.parametrize(("things", "message"), WARNED, ids=[str(text) for _, text in WARNED])
def test_what_may_differ_warns(things, message):
    with pytest.warns(UserWarning, match=f"^{re.escape(message)}$") if message else nullcontext():
        wt.from_mitsuba({**scene(), **things})


APPROXIMATE = [
    (
        {"b": ball(m={"type": "roughdielectric", "alpha": 0.1})},
        "b.m.alpha = 0.1: rough surfaces have no counterpart; a smooth one is taken",
        {"materials__b__refraction": 1},
    ),
    (
        {"b": ball(m={"type": "conductor", "specular_reflectance": [0.9, 0.6, 0.3]})},
        "b.m.specular_reflectance = [0.9, 0.6, 0.3]: coloured weights have no counterpart; "
        "its mean is taken",
        {"materials__b__reflection": 0.6},
    ),
    (
        {"b": {"type": "rectangle"}},
        "b: a rectangle has no counterpart, unless all rectangles close a room; "
        "an infinite plane takes its place",
        {"planes__b__normal": [0, 0, 1], "planes__b__offset": 0},
    ),
    (
        {"sky": {"type": "constant", "radiance": 0.3}, "b": ball()},
        "sky: in Mitsuba the sky lights matte surfaces, and the background here does not; "
        "it is seen, and lights nothing",
        {"background": [0.3] * 3},
    ),
    (
        {"other": SENSOR},
        "other: a second sensor; expected one; the first is taken",
        {"camera__position": [0.1, 0.4, 3]},
    ),
    (
        {"integrator": {"type": "path"}, "b": ball(m=GLASS)},
        "integrator.max_depth: paths without an end have no counterpart; expected a whole number; "
        "max_depth is 10 here",
        {},
    ),
]


@pytest.mark.parametrize(("things", "message", "values"), APPROXIMATE)
def test_what_is_taken_if_it_may_be_approximate(things, message, values):
    with pytest.warns(UserWarning, match=f"^{re.escape(message)}$"):
        found = wt.from_mitsuba({**scene(), **things}, "double", approximate=True)
    assert taken(found, **values)
    assert found.max_depth == (10 if "max_depth" in message else 1)


# XML

XML = """<scene version="3.0.0">
    <default name="depth" value="5"/>
    <integrator type="path"><integer name="max_depth" value="$depth"/></integrator>
    <sensor type="perspective">
        <float name="fov" value="40"/>
        <transform name="to_world">
            <lookat origin="0.1, 0.4, 3" target="0.1, 0.4, 0" up="0, 1, 0"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="12"/> <integer name="height" value="8"/>
            <rfilter type="box"/>
        </film>
    </sensor>
    <bsdf type="twosided" id="red">
        <bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.2, 0.1"/></bsdf>
    </bsdf>
    <shape type="sphere" id="ball">
        <point name="center" x="1" y="2" z="-3"/> <float name="radius" value="0.5"/> <ref id="red"/>
    </shape>
    <shape type="sphere">{}</shape>
    <emitter type="point">
        <rgb name="intensity" value="3"/> <point name="position" value="1, 2, 3"/>
    </emitter>
</scene>"""
CLEAR = '<bsdf type="dielectric"><string name="int_ior" value="bk7"/></bsdf>'


@pytest.fixture
def read(tmp_path):
    """A function that makes a scene of the text of an XML file."""
    pytest.importorskip("mitsuba", reason=NEEDED)

    def read(text, **options):
        path = tmp_path / "scene.xml"
        path.write_text(text)
        return wt.from_mitsuba(path, "double", **options)

    return read


@pytest.mark.filterwarnings("ignore:.*Mitsuba also follows light")
def test_xml(read):
    clear = CLEAR + '<point name="center" x="0" y="0" z="0"/>'
    found = read(XML.format(clear))
    assert taken(
        found,
        spheres__ball__center=[1, 2, -3],
        spheres__ball__radius=0.5,
        spheres__shape0__center=[0, 0, 0],
        materials__red__color=[0.8, 0.2, 0.1],
        materials__shape0__ior=1.5046 / 1.000277,
        lights__emitter0__intensity=[3 / math.pi] * 3,
        camera__position=[0.1, 0.4, 3],
        camera__look_at=[0.1, 0.4, 2],
    )
    assert (found.resolution, found.max_depth) == ((12, 8), 4)
    grey = '<bsdf type="diffuse"><spectrum name="reflectance" value="0.3"/></bsdf>'
    assert taken(read(XML.format(grey)), materials__shape0__color=[0.3] * 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '<bsdf type="roughdielectric"><float name="alpha" value="0.1"/></bsdf>',
            f"shape0.bsdf.alpha = 0.1: {ROUGH}",
        ),
        (
            '<bsdf type="diffuse"><spectrum name="reflectance" value="400:1, 700:0"/></bsdf>',
            'shape0.bsdf.reflectance.type = "spectrum": '
            "spectra have no counterpart; expected 'rgb'",
        ),
        (
            '<ref id="rde"/>',
            "shape0.ref0.id = \"rde\": there is no such object; did you mean 'red'?",
        ),
    ],
)
def test_problems_of_xml_have_paths(read, tmp_path, text, message):
    with pytest.raises(wt.SceneError, match=f"^{re.escape(f'{tmp_path}/scene.xml: {message}')}$"):
        read(XML.format(text))


def test_xml_that_cannot_be_read(read, tmp_path):
    with pytest.raises(wt.SceneError, match=r"scene\.xml: .*unsupported XML element: <bogus>"):
        read('<scene version="3.0.0"><bogus/></scene>')
    with pytest.raises(wt.SceneError, match=r"none\.xml: .*File not found"):
        wt.from_mitsuba(str(tmp_path / "none.xml"))


def test_xml_without_mitsuba(monkeypatch):
    """Only XML needs it."""
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    message = r"^XML is read by Mitsuba, .* install it with: pip install 'whitted\[mitsuba\]'$"
    with pytest.raises(RuntimeError, match=message):
        wt.from_mitsuba("scene.xml")
    assert wt.from_mitsuba(scene(b=ball())).to_mitsuba()["b"]["type"] == "sphere"


# Pictures

LOOK = {"origin": [0.3, 0.5, 2.2], "target": [0, 0.1, 0], "up": [0.1, 1, 0]}
LAMP = {
    "type": "point",
    "position": [1.5, 2, 2],
    "intensity": {"type": "rgb", "value": [20, 30, 40]},
}


@pytest.fixture
def transform():
    """A function that makes the identity, whose methods are Mitsuba's transforms."""
    mitsuba = pytest.importorskip("mitsuba", reason=NEEDED)
    mitsuba.set_variant("scalar_rgb")
    return mitsuba.ScalarTransform4f


def check(source):
    """Compare our picture with Mitsuba's, sample by sample."""
    compare(picture(source), wt.from_mitsuba(source, "double"))


@pytest.mark.parametrize("size", [(12, 8), (8, 12)])
@pytest.mark.parametrize(
    "lens",
    [
        *({"fov": 40, "fov_axis": axis} for axis in ("x", "y", "smaller", "larger", "diagonal")),
        {"focal_length": "35mm"},
        {},
    ],
)
def test_pictures_of_a_moved_ball_and_a_moved_disk(transform, size, lens):
    film = FILM | dict(zip(("width", "height"), size, strict=True))
    sensor = {"type": "perspective", "to_world": transform().look_at(**LOOK), "film": film, **lens}
    moved = transform().translate([0.4, 0, 0]).rotate([1, 0, 0], 30).scale(0.4)
    turned = transform().translate([-0.5, -0.2, -0.5]).rotate([0, 1, 0], 20).scale(0.8)
    source = {
        **scene(
            ball=ball(to_world=moved, center=[0.1, 0.2, 0.3], radius=1.2, bsdf=RED),
            disk={"type": "disk", "to_world": turned, "bsdf": RED},
            lamp=LAMP,
        ),
        "sensor": sensor,
    }
    check(source)


def test_pictures_under_a_turned_sun(transform):
    to_world = transform().look_at(origin=[0, 0, 0], target=[-1, -1.5, -2], up=[0, 0, 1])
    sun = {"type": "directional", "to_world": to_world}
    source = scene(
        sensor={"to_world": transform().look_at(**LOOK)}, ball=ball(bsdf=RED, radius=0.6), sun=sun
    )
    check(source)


def test_pictures_of_a_room_with_turned_tiles(transform):
    """Each wall has another turn of its texture, and another of its two colours at the origin."""
    source = scene(
        sensor={
            "to_world": transform().look_at(**LOOK),
            "fov": 95,
            "film": FILM | {"width": 36, "height": 24},
        },
        lamp=LAMP,
    )
    ups = [0, 1, 0], [1, 0, 0], [0, 0, 1], [0, -1, 0], [1, 0, 0], [0, 0, -1]
    normals = [0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]
    for k, (normal, up) in enumerate(zip(normals, ups, strict=True)):
        behind = (-2.5 * np.array(normal)).tolist()
        to_world = transform().look_at(origin=behind, target=[0, 0, 0], up=up).scale([2.5, 2.5, 1])
        shift = [0.5 * (k // 2 % 2), 0.5 * (k % 2), 0]
        board = {
            "type": "checkerboard",
            "color0": {"type": "rgb", "value": [0.9, 0.1, 0.1]},
            "color1": 0.3,
            "to_uv": transform().translate(shift).scale([5, 5, 1]),
        }
        tiles = {"type": "diffuse", "reflectance": board}
        source[f"wall{k}"] = {"type": "rectangle", "to_world": to_world, "bsdf": tiles}
    check(source)


def test_a_picture_read_from_xml_agrees(read):
    """Mitsuba's own reading of the file, and ours."""
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    text = XML.replace('"5"', '"2"').format("")
    one = read(text)
    loaded = mitsuba.load_string(
        text.replace(
            "</film>",
            '</film><sampler type="stratified"><boolean name="jitter" value="false"/>'
            '<integer name="sample_count" value="1"/></sampler>',
        )
    )
    compare(np.array(mitsuba.render(loaded)), one)
