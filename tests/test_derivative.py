"""Derivatives of images by every parameter, in both modes, against differences and against each
other.
"""

import dataclasses
import re

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from gradcheck import SUM, adjoint_error, compare, directions, jvp, vjp
from samples import CAMERA, LIGHT, SECOND_LIGHT, SHIPPED, SKY, SUN, disc, plane, sphere
from samples import render_plain as render

from whitted.autodiff.changed import changed
from whitted.core.ray import NONE, Ray
from whitted.lights import DirectionalLight
from whitted.scene.files import load_scene

# Every feature at once, all weights strictly between 0 and 1, no number of a parameter 0
MATERIALS = """
[materials.mirror]
color = [0.2, 0.1, 0.15]
specular = 0.5
shininess = 9.5
reflection = 0.8
shadow = 0.9
[materials.glass]
color = [0.05, 0.1, 0.08]
specular = 0.3
shininess = 6.0
reflection = 0.9
refraction = 0.85
ior = 1.5
shadow = 0.4
fresnel = true
[materials.air]
color = [0.04, 0.03, 0.05]
specular = 0.2
shininess = 5.0
shadow = 0.3
reflection = 0.95
refraction = 0.9
ior = 1.05
fresnel = true
[materials.tinted]
color = [0.1, 0.2, 0.1]
specular = 0.2
shininess = 12.0
reflection = 0.3
refraction = 0.6
ior = 1.7
shadow = 0.5
[materials.lacquer]
color = [0.2, 0.05, 0.1]
specular = 0.1
shininess = 8.0
reflection = 0.7
ior = 1.6
shadow = 0.8
fresnel = true
[materials.checks]
color = [0.9, 0.1, 0.2]
specular = 0.1
shininess = 3.5
reflection = 0.15
shadow = 0.7
checker = { color = [0.1, 0.8, 0.7], size = 0.37 }
"""
OBJECTS = (
    sphere([-0.8, -0.2, 0.1], 0.55, "glass")
    + sphere([-0.75, -0.15, 0.15], 0.3, "air")
    + sphere([0.7, -0.3, 0.5], 0.45, "tinted")
    + sphere([0.15, 0.5, -0.6], 0.6, "mirror")
    + sphere([0.62, -0.2, 0.62], 0.2, "lacquer")
    + plane([0.1, 2, 0.05], 0.8, "checks")
    + disc([-0.1, 0.75, 0.4], [0.2, 1, 0.5], 0.4, "tinted")
)
ALL = "max_depth = 4\n" + SKY + CAMERA + MATERIALS + OBJECTS + LIGHT + SECOND_LIGHT + SUN
NAMES = [
    *(f"spheres.sphere{k}.{field}" for k in range(5) for field in ("center", "radius")),
    *(f"planes.plane0.{field}" for field in ("normal", "offset")),
    *(f"discs.disc0.{field}" for field in ("center", "normal", "radius")),
    *(
        f"materials.{name}.{field}"
        for name in ("mirror", "glass", "air", "tinted", "lacquer", "checks")
        for field in ("color", "specular", "shininess", "reflection", "refraction", "ior", "shadow")
    ),
    *(f"materials.checks.checker.{field}" for field in ("color", "size")),
    *(f"lights.light{k}.{field}" for k in range(2) for field in ("position", "intensity")),
    *(f"lights.light2.{field}" for field in ("direction", "irradiance")),
    *("camera.position", "camera.look_at", "camera.fov", "background", "ambient"),
]
HARD = re.sub("shadow = .*\n", "", ALL)
# Nothing of these can be seen: opaque things have no index, no light comes from below the floor;
# the size of a cell and the radius of a disc move nothing but edges
WITHOUT_EFFECT = {
    "materials.mirror.ior",
    "materials.checks.ior",
    "materials.checks.shadow",
    "materials.checks.checker.size",
    "discs.disc0.radius",
}


@pytest.fixture
def image_of():
    """A function from a scene to the function from values to its image."""
    return lambda scene, **options: lambda values: render(scene.replace(values), **options)


def test_all_parameters_are_tested(load):
    assert sorted(load(ALL).parameters()) == sorted(NAMES)


def only(values, name):
    """A direction in which this parameter alone moves; with all of them differentiable, one kernel
    serves all names.
    """
    moving = directions({name: values[name]})
    return {
        other: moving.get(other, np.zeros(np.shape(value.numpy())))
        for other, value in values.items()
    }


def check_differences(image, values, tangents, name):
    compared = compare(image, values, tangents)
    # Few samples have an edge within a step of 2e-5
    assert compared.smooth.mean() > 0.9
    # Rounding: 1e-16, magnified up to 1e4 times by three curved surfaces in turn, over a step of
    # 1e-5. Truncation, of fourth order, is far below
    assert compared.error < 1e-7
    assert np.any(compared.forward[compared.smooth]) == (name not in WITHOUT_EFFECT)


@pytest.mark.parametrize("name", NAMES)
def test_derivative_is_that_of_differences(load, image_of, name):
    scene = load(ALL)
    values = scene.parameters()
    check_differences(image_of(scene, resolution=(24, 18)), values, only(values, name), name)


@pytest.mark.parametrize("name", NAMES)
def test_reverse_mode_is_forward_mode_transposed(load, image_of, name):
    scene = load(ALL)
    values = scene.parameters()
    assert adjoint_error(image_of(scene), values, only(values, name)) < SUM


ALONE = [
    "spheres.sphere1.radius",
    "planes.plane0.offset",
    "materials.glass.ior",
    "materials.air.ior",
    "materials.checks.color",
    "materials.checks.checker.color",
    "materials.tinted.shadow",
    "materials.lacquer.ior",
    "discs.disc0.normal",
    "lights.light2.direction",
    "lights.light1.intensity",
    "background",
    "camera.fov",
]


@pytest.mark.parametrize("name", ALONE)
@pytest.mark.parametrize("text", [ALL, HARD], ids=["partial shadows", "full shadows"])
def test_derivative_by_one_parameter_alone_is_that_of_differences(load, image_of, text, name):
    """The kernels for derivatives by one parameter only leave out all light that it does not
    change.
    """
    scene = load(text)
    image, values = image_of(scene, resolution=(24, 18)), scene.parameters(name)
    check_differences(image, values, directions(values), name)
    assert adjoint_error(image, values, directions(values)) < SUM


def test_derivative_by_the_index_of_what_is_around_the_camera(load, image_of):
    """The index bends rays at other spheres, before they meet anything whose parameters change."""
    around = sphere([0, 0, 1.5], 2.5, "glass") + sphere([0.1, 0.1, 0.3], 0.8, "air")
    scene = load("max_depth = 4\n" + SKY + CAMERA + MATERIALS + around + LIGHT)
    image, values = (
        image_of(scene, resolution=(24, 18), max_depth=2),
        scene.parameters("materials.glass.ior"),
    )
    check_differences(image, values, directions(values), "materials.glass.ior")
    assert adjoint_error(image, values, directions(values)) < SUM


@pytest.mark.slow
@pytest.mark.parametrize(("depth", "importance"), [(1, 0), (7, 0), (7, 0.05)])
def test_derivatives_by_all_parameters_at_once_add_up(load, image_of, depth, importance):
    scene = load(f"min_importance = {importance}\n" + ALL)
    image, values = image_of(scene, max_depth=depth, spp=4), scene.parameters()
    assert adjoint_error(image, values, directions(values)) < SUM
    # Two halves add up: forward mode is linear in its direction
    tangents = directions(values)
    halves = [dict(list(values.items())[k::2]) for k in range(2)]
    parts = sum(jvp(image, half, tangents) for half in halves)
    together = jvp(image, values, tangents)
    np.testing.assert_allclose(together, parts, rtol=0, atol=SUM * abs(together).max())


def test_single_precision_has_the_same_derivatives(load, image_of):
    """As a sum over the image, in which no one sample counts for much. A sample beside an edge may
    fall on its other side.
    """
    gradients = {}
    for precision in ("single", "double"):
        scene = load(ALL, precision)
        image, values = image_of(scene, max_depth=2), scene.parameters()
        weights = np.random.default_rng(3).uniform(0, 1, (12, 16, 3))
        gradients[precision] = vjp(image, values, weights)
    for name, exact in gradients["double"].items():
        scale = abs(exact).max() or 1
        # Curved surfaces magnify a rounding of 1e-7 a hundredfold, in 192 samples of both signs
        # that add up to no less than a tenth of their moduli
        np.testing.assert_allclose(
            gradients["single"][name], exact, rtol=0, atol=1e-4 * scale, err_msg=name
        )


def test_derivative_by_a_reflection_of_zero_is_what_the_mirror_would_show(load, image_of):
    """L = (light of the surface) + reflection * (radiance of the mirrored ray), also where the
    reflection is 0.
    """
    dull = load(ALL.replace("reflection = 0.8", "reflection = 0"))
    mirror = load(ALL.replace("reflection = 0.8", "reflection = 1"))
    name = "materials.mirror.reflection"
    # At depth 2 each camera ray meets the mirror at most once, as its first surface
    image = image_of(dull, max_depth=2)
    values = dull.parameters(name)
    np.testing.assert_array_equal(values[name].numpy(), 0)
    shown = render(mirror, max_depth=2).numpy() - render(dull, max_depth=2).numpy()
    assert shown.max() > 0.1
    one = {name: np.ones(1)}
    # A difference of two images of numbers near 1, a few dozens of roundings
    np.testing.assert_allclose(jvp(image, values, one), shown, rtol=0, atol=1e-14)
    weights = np.random.default_rng(2).uniform(-1, 1, shown.shape)
    # A sum of 576 products of both signs, in another order
    np.testing.assert_allclose(vjp(image, values, weights)[name], np.sum(weights * shown), rtol=SUM)


@pytest.mark.parametrize("field", ["reflection", "refraction"])
@pytest.mark.parametrize("material", ["glass", "tinted"])
def test_derivative_by_a_weight_of_zero_in_glass(load, image_of, material, field):
    """A weight that is 0 has the derivative that differences at 0 have.

    A kernel that did not trace rays of weight 0 would find none.
    """
    head, tail = ALL.split(f"[materials.{material}]")
    body, *rest = tail.split("[materials.", 1)
    lines = [f"{field} = 0" if line.startswith(field) else line for line in body.splitlines()]
    scene = load(
        "[materials.".join([head + f"[materials.{material}]" + "\n".join(lines) + "\n", *rest])
    )
    name = f"materials.{material}.{field}"
    values, image = scene.parameters(name), image_of(scene, max_depth=2)
    if field == "refraction":
        # At 0 the sphere is opaque and fills nothing, and for any other weight it bends rays: there
        # are no differences to compare with
        tangent = jvp(image, values, {name: np.ones(1)})
        assert np.isfinite(tangent).all()
        assert np.any(tangent)
        return
    compared = compare(image, values, {name: np.ones(1)})
    # As in `check_differences`
    assert compared.error < 1e-7
    assert np.any(compared.forward[compared.smooth])
    assert adjoint_error(image, values, {name: np.ones(1)}) < SUM


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_reverse_mode_is_forward_mode_in_example_scenes(path, image_of):
    scene = load_scene(path, "double")
    values = scene.parameters()
    assert adjoint_error(image_of(scene, resolution=(32, 32)), values, directions(values)) < SUM


def test_what_a_kernel_takes_may_depend_on_several_parameters(load, image_of, monkeypatch):
    """A light's `prepared` may make one of its numbers of others; here, irradiance of direction."""

    def prepared(light):
        brighter = light.irradiance * dr.exp(light.direction.x)
        return dataclasses.replace(
            light, direction=dr.normalize(light.direction), irradiance=brighter
        )

    monkeypatch.setattr(DirectionalLight, "prepared", prepared)
    loaded = load(SKY + CAMERA + MATERIALS + plane([0, 1, 0], 0.8, "tinted") + SUN)
    name = "lights.light0.direction"
    image, values = image_of(loaded), loaded.parameters(name)
    check_differences(image, values, directions(values), name)
    assert adjoint_error(image, values, directions(values)) < SUM


def test_what_nothing_depends_on_has_derivatives_of_zero_and_changes_no_other(image_of):
    """The index of an opaque wall that reflects nothing, and the shininess of a matte one."""
    scene = load_scene("cornell", precision="double")
    idle = ["materials.white.ior", "materials.red.shininess", "materials.mirror.ior"]
    # The mirror's highlight has a shininess that matters
    names = ["spheres.mirror.center", "materials.glass.ior", "materials.mirror.shininess"]
    found = []
    for chosen in (names, names + idle):
        image, values = image_of(scene, resolution=(16, 16)), scene.parameters(*chosen)
        found.append(vjp(image, values, np.ones((16, 16, 3))))
    assert all(np.all(found[1][name] == 0) for name in idle)
    for name in names:
        assert np.any(found[0][name] != 0)
        np.testing.assert_array_equal(found[1][name], found[0][name])


def test_rays_reach_what_changes_or_sends_rays_on(load):
    text = SKY + CAMERA + MATERIALS + "[materials.matte]\ncolor = [0.5, 0.5, 0.5]\n"
    for x, name, made in ((0, "moves", "mirror"), (2, "mirrors", "mirror")):
        text += sphere([x, 0, 0], 0.5, made, name)
    for x, name in ((4, "still"), (6, "grows")):
        text += sphere([x, 0, 0], 0.5, "matte", name)
    scene = load(text)
    names = [scene.structure.names[f"spheres.{name}.radius"] for name in ("moves", "grows")]
    kernel, vector = scene.structure.filled(scene.inputs()), scene.precision.vector
    origin = vector(dr.arange(scene.precision.real, 5) * 2, 0, 5)
    ray = Ray(origin, vector(0, 0, -1), ad.UInt(NONE), ad.Bool(False))
    reached = changed(kernel, names).reached(kernel, ray)
    assert reached.numpy().tolist() == [True, True, False, True, False]
