"""A scene's parameters: their names, copies and replacements."""

import math

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from drjit.opt import Adam
from samples import CAMERA, LIGHT, SCENES, keys, material, plane, sphere
from samples import render_plain as render

TYPES = {"single": (ad.Float, ad.Array3f), "double": (ad.Float64, ad.Array3f64)}
RED = {
    "color": [0.8, 0.2, 0.1],
    "specular": 0.4,
    "shininess": 7.5,
    "reflection": 0.25,
    "refraction": 0.5,
    "ior": 1.25,
    "shadow": 0.75,
}
TEXT = (
    keys(background=[0.1, 0.2, 0.3], ambient=[0.3, 0.2, 0.1])
    + CAMERA
    + material("red", **RED)
    + sphere([-0.5, 0.25, 0.125], 0.5, "red", name="ball")
    + sphere([0.5, 0, 0], 0.25, "red")
    + plane([0, 2, 0], 1.5, "red")
    + LIGHT
)
EXPECTED = {
    "spheres.ball.center": [-0.5, 0.25, 0.125],
    "spheres.ball.radius": [0.5],
    "spheres.sphere1.center": [0.5, 0, 0],
    "spheres.sphere1.radius": [0.25],
    "planes.plane0.normal": [0, 1, 0],  # made unit on load
    "planes.plane0.offset": [1.5],
    "materials.red.color": [0.8, 0.2, 0.1],
    "materials.red.specular": [0.4],
    "materials.red.shininess": [7.5],
    "materials.red.reflection": [0.25],
    "materials.red.refraction": [0.5],
    "materials.red.ior": [1.25],
    "materials.red.shadow": [0.75],
    "lights.light0.position": [1.5, 2.4, 2.0],
    "lights.light0.intensity": [0.9, 0.8, 0.7],
    "camera.position": [0.1, 0.4, 3.2],
    "camera.look_at": [0, 0, 0],
    "camera.fov": [50],
    "background": [0.1, 0.2, 0.3],
    "ambient": [0.3, 0.2, 0.1],
}


def numbers(values):
    return {name: value.numpy().ravel().tolist() for name, value in values.items()}


def test_parameters_have_the_numbers_of_the_file(load, precision):
    params = load(TEXT, precision).parameters()
    assert list(params) == list(EXPECTED)
    for name, value in params.items():
        assert type(value) is TYPES[precision][len(EXPECTED[name]) == 3], name
        assert dr.width(value) == 1
        # As near as the precision has a number: half a spacing
        np.testing.assert_allclose(
            value.numpy().ravel(),
            EXPECTED[name],
            rtol=6e-8 if precision == "single" else 0,
            err_msg=name,
        )


def test_parameters_by_name_come_in_that_order(load):
    names = ["materials.red.ior", "background", "spheres.ball.radius"]
    assert list(load(TEXT).parameters(*names)) == names


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("spheres.ball.centre", "nearest: spheres.ball.center"),
        ("materials.blue.ior", "nearest: .*materials.red.ior"),
        ("camera.fovy", "nearest: camera.fov"),
        ("ambiant", "nearest: ambient"),
        ("", "nearest: spheres.ball.center, spheres.ball.radius, spheres.sphere1.center"),
        ("camera.upp", "nearest: camera"),
        ("zzz", "nearest: spheres.ball.center, spheres.ball.radius, spheres.sphere1.center"),
    ],
)
def test_unknown_name_is_refused_with_the_nearest_ones(load, name, near):
    scene = load(TEXT)
    with pytest.raises(KeyError, match=rf"the scene has no parameter '{name}'; {near}"):
        scene.parameters("background", name)
    with pytest.raises(KeyError, match=rf"the scene has no parameter '{name}'; {near}"):
        scene.replace({"background": 1, name: 1})


@pytest.mark.parametrize(
    "value",
    [
        [1, 2],
        [1, 2, 3],
        [],
        "one",
        None,
        {},
        [[1], [2]],
        ad.Array3f64(1),
        ad.Float64(1, 2),
        ad.TensorXf64([1, 2]),
        object(),
        math.nan,
        math.inf,
        True,
        np.True_,
        "1.5",
        10**400,
        1 + 0j,
    ],
)
def test_value_that_is_not_one_number_is_refused(load, value):
    with pytest.raises(ValueError, match=r"^materials\.red\.ior: expected one number, got "):
        load(TEXT).replace({"materials.red.ior": value})


@pytest.mark.parametrize(
    "value",
    [
        1,
        [1, 2],
        [1, 2, 3, 4],
        "red",
        None,
        [1, 2, None],
        ["1", "2", "3"],
        [True, 0, 0],
        [1, [2], 3],
        ad.Float64(1),
        ad.TensorXf64([1, 2]),
        ad.Array2f64(1),
        dr.zeros(ad.Array3f64, 2),
    ],
)
def test_value_that_is_not_one_vector_is_refused(load, value):
    with pytest.raises(
        ValueError, match=r"^background: expected one vector of three numbers, got "
    ):
        load(TEXT).replace({"background": value})


@pytest.mark.parametrize(
    "value",
    [
        1.75,
        np.float32(1.75),
        np.array(1.75),
        np.array([1.75]),
        [1.75],
        ad.Float(1.75),
        ad.Float64(1.75),
        ad.TensorXf(1.75),
        ad.TensorXf64([1.75]),
    ],
)
def test_a_number_is_taken_in_any_form(load, precision, value):
    read = (
        load(TEXT, precision)
        .replace({"materials.red.ior": value})
        .parameters("materials.red.ior")["materials.red.ior"]
    )
    assert (type(read), read.numpy().tolist()) == (TYPES[precision][0], [1.75])


@pytest.mark.parametrize(
    "value",
    [
        [1, 0.5, 2],
        (1, 0.5, 2),
        np.array([1, 0.5, 2]),
        np.array([[1], [0.5], [2]]),
        [ad.Float(1), np.float32(0.5), 2],
        ad.Array3f(1, 0.5, 2),
        ad.Array3f64(1, 0.5, 2),
        ad.TensorXf([1, 0.5, 2]),
        ad.TensorXf64([1, 0.5, 2], (1, 3)),
    ],
)
def test_a_vector_is_taken_in_any_form(load, precision, value):
    read = (
        load(TEXT, precision).replace({"background": value}).parameters("background")["background"]
    )
    assert (type(read), read.numpy().ravel().tolist()) == (TYPES[precision][1], [1, 0.5, 2])


def test_other_precision_keeps_the_gradient(load):
    """An array of the other precision is converted by an operation that gradients pass through."""
    value = ad.Float(0.5)
    dr.enable_grad(value)
    dr.backward(dr.sum(render(load(TEXT).replace({"materials.red.reflection": value})).array))
    assert dr.grad(value).numpy()[0] != 0


def test_replacing_any_parameter_replaces_that_one_alone(load):
    scene = load(TEXT)
    before = numbers(scene.parameters())
    for name, value in before.items():
        new = [x + 0.125 for x in value]
        changed = scene.replace({name: new})
        assert numbers(changed.parameters()) == before | {name: new}
        assert numbers(scene.parameters()) == before


def test_parameters_are_copies(load):
    scene = load(TEXT)
    before = numbers(scene.parameters())
    params = scene.parameters()
    dr.enable_grad(params)
    for value in params.values():
        value += 1
    assert numbers(scene.parameters()) == before
    assert not any(dr.grad_enabled(value) for value in scene.parameters().values())
    assert not dr.grad_enabled(render(scene))


def test_replaced_parameters_carry_gradients(load):
    scene = load(TEXT)
    params = scene.parameters("spheres.ball.center")
    dr.enable_grad(params)
    replaced = scene.replace(params)
    assert dr.grad_enabled(replaced.parameters("spheres.ball.center"))
    assert not dr.grad_enabled(replaced.parameters("spheres.ball.radius"))
    # The second time the gradient goes through both
    dr.backward(dr.sum(render(replaced.replace({"ambient": [1, 1, 1]})).array))
    assert np.any(params["spheres.ball.center"].grad.numpy())


def test_gradients_go_on_to_what_a_parameter_was_computed_from(load):
    """The chain rule goes on outside of the scene: half the step, twice the slope."""
    scene = load(TEXT)
    radius = ad.Float64(0.4)
    gradients = []
    for factor in (1, 2):
        outer = radius / factor
        dr.enable_grad(outer)
        dr.backward(dr.sum(render(scene.replace({"spheres.ball.radius": outer * factor})).array))
        gradients.append(dr.grad(outer).numpy()[0])
    # The same sum; the radius is off by a rounding of 0.4
    assert gradients[1] == pytest.approx(2 * gradients[0], rel=1e-12)


def test_gradients_go_on_to_tensors(load, precision):
    center, ior = ad.TensorXf([0, 0, -4]), ad.TensorXf64([1.5])
    dr.enable_grad(center, ior)
    read = (
        load(TEXT, precision)
        .replace({"background": center, "materials.red.ior": ior})
        .parameters("background", "materials.red.ior")
    )
    dr.backward(read["background"].y * 2 + read["materials.red.ior"] * 3)
    assert (center.grad.numpy().tolist(), ior.grad.numpy().tolist()) == ([0, 2, 0], [3])


def test_replaced_zero_is_compiled(load):
    """What was 0 in the file, and left out of the kernel, counts once it is replaced."""
    scene = load(SCENES["black sky, no ambient"])
    lit = scene.replace({"background": [0.25, 0.5, 1], "ambient": [1, 1, 1]})
    sky = keys(background=[0.25, 0.5, 1], ambient=[1, 1, 1])
    expected = load(sky + SCENES["black sky, no ambient"])
    np.testing.assert_array_equal(render(lit).numpy(), render(expected).numpy())
    assert abs(render(lit).numpy() - render(scene).numpy()).max() > 0.1


@pytest.mark.parametrize("name", ["spheres.ball.radius", "materials.red.color", "camera.position"])
def test_optimiser_of_drjit_lowers_a_loss(load, precision, name):
    scene = load(TEXT, precision)
    target = render(scene)
    start = scene.parameters(name)
    opt = Adam(lr=0.002, params={name: start[name] + 0.04})
    losses = []
    for _ in range(4):
        image = render(scene.replace(opt))
        loss = dr.mean(dr.square(image - target), axis=None)
        losses.append(loss.numpy().item())
        dr.backward(loss)
        opt.step()
    # One step of Adam is as long as its rate, a twentieth of the way
    assert losses[3] < losses[0]


def test_optimiser_takes_parameters_as_they_are(load):
    scene = load(TEXT)
    opt = Adam(lr=0.01, params=scene.parameters("materials.red.color", "background"))
    dr.backward(dr.sum(render(scene.replace(opt)).array))
    opt.step()
    moved = numbers(scene.replace(opt).parameters())
    # All of both brighten the image, so that Adam's first step takes its rate off each number, but
    # for the 1e-8 that it adds to the slope's modulus, which is above 1
    for name in ("materials.red.color", "background"):
        np.testing.assert_allclose(moved[name], np.array(EXPECTED[name]) - 0.01, rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        (
            "spheres.ball.radius",
            -0.25,
            r"spheres.ball.radius = -0.25: expected a number > 0; bound the steps",
        ),
        ("materials.red.ior", 0, r"materials.red.ior = 0: expected a number > 0"),
        ("materials.red.shininess", -1, r"materials.red.shininess = -1: expected a number > 0"),
        ("camera.fov", 180, r"camera.fov = 180: expected an angle in degrees, in \(0, 180\)"),
        (
            "spheres.ball.center",
            [0, math.nan, 1],
            r"spheres.ball.center = 0, nan, 1: expected three finite numbers",
        ),
        (
            "planes.plane0.normal",
            [0, 0, 0],
            r"planes.plane0.normal = 0, 0, 0: expected a direction",
        ),
    ],
)
def test_step_of_an_optimiser_to_a_number_without_meaning_is_refused(load, name, value, message):
    scene = load(TEXT)
    params = scene.parameters(name)
    params[name] = type(params[name])(value)
    dr.enable_grad(params)
    with pytest.raises(ValueError, match=message):
        scene.replace(params)


def test_equal_scenes(load, precision):
    """Equal are scenes of the same text; to replace a number by itself makes no difference."""
    one, other = load(TEXT, precision), load(TEXT, precision)
    assert one == other
    assert hash(one) == hash(other)
    assert one.replace({"ambient": [0.3, 0.2, 0.1], "materials.red.shadow": 0.75}) == other
    assert one != TEXT


@pytest.mark.parametrize("name", EXPECTED)
def test_scenes_with_another_number(load, precision, name):
    """The smallest change of any number counts."""
    scene = load(TEXT, precision)
    number = np.float32 if precision == "single" else np.float64
    *others, last = scene.numbers[name]
    changed = [*others, float(np.nextafter(number(last), number(1e9)))]
    assert scene.replace({name: changed}) != scene


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('name = "ball"', 'name = "marble"'),
        ("background", "max_depth = 4\nbackground"),
        ("background", "min_importance = 0.5\nbackground"),
        ("resolution = [", "resolution = [1"),
        ("[[planes]]", '[[planes]]\nname = "floor"'),
        ("color = [0.8, 0.2, 0.1]", "color = [0.8, 0.2, 0.1]\nfresnel = true"),
    ],
)
def test_scenes_with_another_structure(load, old, new):
    text = TEXT.replace(old, new, 1)
    assert text != TEXT
    assert load(text) != load(TEXT)


def test_scenes_of_another_precision(load):
    assert load(TEXT, "single") != load(TEXT, "double")
