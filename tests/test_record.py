"""What rays among many spheres have met is kept, so that derivatives search for it only once."""

import drjit as dr
import numpy as np
import pytest

import whitted as wt
from whitted.edges import blocks
from whitted.rendering import job

CENTER, RADIUS = "clouds.balls.center", "clouds.balls.radius"
LIGHTS = [
    wt.PointLight("key", position=(2, 4, 3), intensity=(0.9, 0.9, 0.9)),
    wt.DirectionalLight("sun", direction=(-1, -2, -0.5), irradiance=(0.4, 0.4, 0.4)),
]


def balls(count=300, precision="double", **material):
    """Mirror balls above a plane."""
    rng = np.random.default_rng(4)
    rows = np.column_stack([rng.uniform(-1, 1, (count, 3)), rng.uniform(0.05, 0.12, count)])
    look = {"color": (0.5, 0.4, 0.3), "specular": 0.3, "shininess": 20, "reflection": 0.5}
    mirror = wt.Material("mirror", **{**look, **material})
    return wt.Scene(
        camera=wt.Camera(position=(0, 1.2, 4.5), look_at=(0, 0, 0), fov=30, resolution=(24, 20)),
        clouds=[wt.Cloud("balls", spheres=rows, material=mirror)],
        planes=[wt.Plane("floor", normal=(0, 1, 0), offset=1.2, material=mirror)],
        lights=LIGHTS,
        ambient=(0.1, 0.1, 0.1),
        max_depth=3,
        precision=precision,
    )


def gradients(scene, names, **options):
    """The derivatives of a weighted sum of pixels, in reverse mode, and in forward mode by all
    numbers at once.
    """
    weights = np.random.default_rng(1).uniform(size=(*scene.resolution[::-1], 3))
    found = []
    for forward in (False, True):
        values = scene.parameters(*names)
        dr.enable_grad(values)
        image = wt.render(scene.replace(values), **options)
        loss = dr.sum(image * type(image)(weights), axis=None)
        if forward:
            for value in values.values():
                dr.set_grad(value, dr.ones(type(value)))
            found.append(dr.forward_to(loss).numpy())
        else:
            dr.backward(loss)
            found += [dr.grad(value).numpy() for value in values.values()]
    return found


def agree(a, b, tolerance):
    for one, two in zip(a, b, strict=True):
        np.testing.assert_allclose(one, two, rtol=0, atol=tolerance * np.abs(two).max())


@pytest.mark.parametrize("spp", [1, 4])
def test_derivatives_between_edges_are_those_of_a_second_search(monkeypatch, spp):
    scene, options = balls(), {"boundary": False, "spp": spp}
    kept = gradients(scene, (CENTER, RADIUS), **options)
    monkeypatch.setattr(job, "MOST_NODES", 0)
    # The same sums, in another kernel
    agree(kept, gradients(scene, (CENTER, RADIUS), **options), 1e-12)


@pytest.mark.parametrize(("depth", "tolerance"), [(1, 1e-12), (3, 0.03)])
def test_right_derivatives_are_those_of_a_second_search(monkeypatch, depth, tolerance):
    """From near by, so that few edges are between two samples.

    Between two samples a ray is taken to meet on its way what they have met. In mirrors, a few
    have a third thing in between.
    """
    scene = balls().replace({"camera.fov": 5, "max_depth": depth})
    kept = gradients(scene, (CENTER, RADIUS))
    monkeypatch.setattr(blocks, "MOST_NODES", 0)
    agree(kept, gradients(scene, (CENTER, RADIUS)), tolerance)


@pytest.mark.parametrize("boundary", [False, True])
def test_a_weight_of_zero_is_differentiated(boundary):
    """It takes rays that the image does not trace."""
    names, step = ("materials.mirror.reflection",), 1e-5
    scene = balls(reflection=0.0).replace({names[0]: 0.0})
    (slope, _) = gradients(scene, names, boundary=boundary)
    weights = np.random.default_rng(1).uniform(size=(20, 24, 3))
    two = [
        (wt.render(scene.replace({names[0]: x}), boundary=boundary).numpy() * weights).sum()
        for x in (step, 0)
    ]
    # The image is a polynomial of degree 2 in the weight; a few edges of faint light are left out
    assert slope.item() == pytest.approx((two[0] - two[1]) / step, rel=2e-2 if boundary else 1e-3)


@pytest.mark.parametrize("spp", [1, 4])
@pytest.mark.parametrize("precision", ["single", "double"])
def test_an_image_with_derivatives_is_the_same_image(precision, spp):
    """Its crowded pixels take the samples of the derivatives."""
    scene = balls(precision=precision)
    values = scene.parameters(CENTER)
    dr.enable_grad(values)
    image = dr.detach(wt.render(scene.replace(values), spp=spp)).numpy()
    np.testing.assert_array_equal(image, wt.render(scene, spp=spp).numpy())


@pytest.mark.parametrize(
    ("material", "recorded"),
    [
        ({}, True),
        ({"reflection": 0.0}, True),
        ({"refraction": 0.5}, False),
        ({"shadow": 0.5}, False),
        ({"shadow": 0.0}, True),
    ],
)
def test_hits_are_kept_of_chains_with_full_shadows(material, recorded):
    assert balls(10, **material).structure.recorded == recorded
