"""Where rays meet spheres and planes, at sizes and places where plain formulas lose their digits,
in both precisions.
"""

import math

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from samples import LIGHT, sphere
from samples import render_plain as render

from whitted.core.numerics import safe_normalize, two_sum
from whitted.core.ray import NONE, Ray, ShadowRay
from whitted.shapes import Plane, Sphere

TYPES = {"single": (ad.Float, ad.Array3f), "double": (ad.Float64, ad.Array3f64)}
EPSILON = {"single": 2.0**-23, "double": 2.0**-52}
WHITE = "[materials.white]\ncolor = [1, 1, 1]\n"


def ball(vector, center, radius, compensated=False):
    return Sphere("ball", "", vector(*map(float, center)), dr.value_t(vector)(radius), compensated)


def ray_of(o, d, inward=False):
    mask, width = dr.mask_t(o.x), dr.width(o, d)
    uint = dr.uint32_array_t(o.x)
    return Ray(o, d, dr.full(uint, NONE, width), dr.full(mask, inward, width))


def meets(sphere, ray, on=False):
    """Distance, whether the sphere is met, whether from within: as NumPy arrays."""
    return tuple(x.numpy() for x in sphere.distance(ray, dr.mask_t(ray.inward)(on)))


def segment(p, light):
    """The way from a point to a light, from no surface."""
    distance = dr.norm(light - p)
    uint, mask = dr.uint32_array_t(distance), dr.mask_t(distance)
    return ShadowRay(p, (light - p) / distance, distance, light, uint(NONE), mask(False))


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize("offset", [-1e-3, -1e-6, -1e-7, 0, 1e-7, 1e-6, 1e-3])
def test_tangent_ray(precision, compensated, offset):
    """Stress 1: a hit or a miss, the same for the search and for shadows; the search has no
    gradient, see `test_trace`.
    """
    real, vector = TYPES[precision]
    for degrees in range(0, 360, 7):
        direction = math.radians(degrees)
        radius, d = real(1), vector(math.cos(direction), math.sin(direction), 0)
        side = vector(-math.sin(direction), math.cos(direction), 0)
        o = -3 * d + side * (1 + offset)
        target, no = Sphere("", "", vector(0), radius, compensated), dr.mask_t(radius)(False)
        t, hit, _ = target.distance(ray_of(o, d), no)
        beyond = ShadowRay(o, d, real(6), o + 6 * d, dr.uint32_array_t(real)(NONE), no)
        assert hit.numpy() == target.blocks(beyond, no).numpy()
        if abs(offset) > 10 * EPSILON[precision]:
            assert hit.numpy() == (offset < 0)
        if hit.numpy()[0]:
            # sqrt(2 * offset), and of a rounding
            assert t.numpy()[0] == pytest.approx(
                3, abs=math.sqrt(2 * abs(offset) + 20 * EPSILON[precision])
            )


@pytest.mark.parametrize("compensated", [False, True])
def test_exactly_tangent_ray_is_the_same_to_search_and_shadow(precision, compensated):
    """Stress 1."""
    real, vector = TYPES[precision]
    target, o, d, no = (
        ball(vector, (0, 0, 0), 1, compensated),
        vector(3, 1, 0),
        vector(-1, 0, 0),
        dr.mask_t(real)(False),
    )
    beyond = ShadowRay(o, d, real(6), o + 6 * d, dr.uint32_array_t(real)(NONE), no)
    assert meets(target, ray_of(o, d))[1] == target.blocks(beyond, no).numpy()


@pytest.mark.parametrize("distance", [1e2, 1e3, 1e4])
def test_silhouette_of_a_distant_sphere(precision, distance):
    """Stress 2: a unit sphere covers pi of parallel rays, without rings."""
    real, vector = TYPES[precision]
    side = 2000
    at = (np.arange(side) + 0.5) / side * 2.2 - 1.1
    x, y = (real(a.ravel()) for a in np.meshgrid(at, at))
    o, d = vector(x, y, real(0)), vector(0, 0, -1)
    _, hit, _ = meets(ball(vector, (0, 0, -distance), 1), ray_of(o, d))
    # The grid's own error is a thousandth of a cell's share of the rim
    assert hit.sum() * (2.2 / side) ** 2 == pytest.approx(math.pi, rel=1e-4)
    # No rings: away from the rim by a few roundings of a unit's size, a hit is what the distance
    # from the axis says
    squared = x.numpy().astype(float) ** 2 + y.numpy().astype(float) ** 2
    clear = abs(squared - 1) > 10 * EPSILON[precision]
    np.testing.assert_array_equal(hit[clear], squared[clear] < 1)


@pytest.mark.parametrize("distance", [1e2, 1e3, 1e4])
def test_distance_to_a_distant_sphere(precision, distance):
    """Stress 2: the distance's error is a rounding of the distance, not of its square."""
    vector = TYPES[precision][1]
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-0.7, 0.7, (2, 1000)).astype(np.float32)
    t, hit, _ = meets(
        ball(vector, (0, 0, -distance), 1), ray_of(vector(x, y, np.zeros_like(x)), vector(0, 0, -1))
    )
    assert hit.all()
    expected = distance - np.sqrt(1 - x.astype(float) ** 2 - y.astype(float) ** 2)
    np.testing.assert_allclose(t, expected, rtol=0, atol=2 * EPSILON[precision] * distance)


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize("radius", [1e-4, 1e-2, 1, 1e2, 1e4])
def test_leaving_ones_own_surface(precision, radius, compensated):
    """Stress 6: outward there is no hit at all, inward the other end of the chord, at -2 r d . n."""
    real, vector = TYPES[precision]
    rng = np.random.default_rng(6)
    n = rng.normal(size=(3, 10000))
    d = rng.normal(size=(3, 10000))
    n, d = n / np.linalg.norm(n, axis=0), d / np.linalg.norm(d, axis=0)
    center = np.array([0.3, -0.2, 0.5]) * radius
    target = ball(vector, center, radius, compensated)
    normal, direction = vector(*(real(c) for c in n)), vector(*(real(c) for c in d))
    o = normal * radius + target.center
    slope = np.sum(n * d, axis=0)
    _, hit, _ = meets(target, ray_of(o, direction), on=True)
    assert not hit.any()
    inward = slope < 0
    t, hit, within = meets(target, ray_of(o, direction, inward=True), on=True)
    assert hit.all()
    assert within.all()
    # Roundings of the origin, some radii large
    np.testing.assert_allclose(
        t[inward], -2 * radius * slope[inward], rtol=0, atol=8 * EPSILON[precision] * radius
    )
    assert (t >= 0).all()


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize("radius", [1e-4, 0.5, 3, 1e4])
def test_origin_at_the_center(precision, radius, compensated):
    """Stress 7: every direction meets the sphere at its radius, from within."""
    vector = TYPES[precision][1]
    target = ball(vector, (1, -2, 0.5), radius, compensated)
    rng = np.random.default_rng(7)
    d = dr.normalize(vector(*rng.normal(size=(3, 100))))
    t, hit, within = meets(target, ray_of(target.center + dr.zeros(vector, 100), d))
    assert hit.all()
    assert within.all()
    np.testing.assert_allclose(t, radius, rtol=4 * EPSILON[precision])


@pytest.mark.parametrize("compensated", [False, True])
def test_sphere_behind(precision, compensated):
    """Stress 7: a miss."""
    vector = TYPES[precision][1]
    _, hit, _ = meets(
        ball(vector, (0, 0, 3), 1, compensated), ray_of(vector(0.1, 0, 0), vector(0, 0, -1))
    )
    assert not hit.any()


def test_sphere_behind_has_no_gradient(load, precision):
    """Stress 7."""
    text = "background = [1, 1, 1]\nambient = [1, 1, 1]\n" + CAMERA + WHITE + LIGHT
    scene = load(text + sphere([0, 0, 9], 1, "white"), precision)
    params = scene.parameters("spheres.sphere0.center", "spheres.sphere0.radius")
    dr.enable_grad(params)
    image = render(scene.replace(params))
    dr.backward(dr.sum(image.array))
    np.testing.assert_array_equal(dr.detach(image).numpy(), 1)
    for value in params.values():
        np.testing.assert_array_equal(dr.grad(value).numpy(), 0)


@pytest.mark.parametrize("compensated", [False, True])
def test_ray_from_within(precision, compensated):
    vector = TYPES[precision][1]
    t, hit, within = meets(
        ball(vector, (0, 0, 0), 2, compensated), ray_of(vector(0, 0, 1.5), vector(0, 0, -1))
    )
    assert (hit.all(), within.all()) == (True, True)
    np.testing.assert_allclose(t, 3.5, rtol=4 * EPSILON[precision])


def test_plane_in_front_behind_and_along(precision):
    real, vector = TYPES[precision]
    floor = Plane("", "", vector(0, 1, 0), real(1))
    o, no = vector(0.3, 1, 0), dr.mask_t(real)(False)
    assert floor.distance(ray_of(o, vector(0, -1, 0)), no)[0].numpy() == 2
    assert floor.distance(ray_of(o, vector(0, 1, 0)), no)[0].numpy() == -2
    assert not np.isfinite(floor.distance(ray_of(o, vector(1, 0, 0)), no)[0].numpy())


def test_plane_blocks_only_between_its_sides(precision):
    real, vector = TYPES[precision]
    floor = Plane("", "", vector(0, 1, 0), real(1))
    for a, b, expected in (
        (1, -3, True),
        (-3, 1, True),
        (1, 2, False),
        (-3, -2, False),
        (-1, 2, False),
        (1, -1, False),
    ):
        ray = segment(vector(0, a, 0), vector(5, b, 0))
        assert floor.blocks(ray, dr.mask_t(real)(False)).numpy() == expected


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [
        ((0, 0, 3), (0, 0, -3), True),
        ((0, 0, 3), (0, 0, 2), False),  # the sphere is beyond the light
        ((0, 0, 3), (0, 0, 4), False),  # and behind the start
        ((0, 0, 3), (0, 0, 0), True),  # the light is in it
        ((0, 0, 0), (0, 0, 3), True),
        ((0, 0.5, 0), (0, 0, 0.5), False),  # all of the segment is in it
        ((0, 1.01, 3), (0, 1.01, -3), False),
        ((0, 0.99, 3), (0, 0.99, -3), True),
    ],
)
def test_sphere_blocks(precision, compensated, start, end, expected):
    real, vector = TYPES[precision]
    target, no = ball(vector, (0, 0, 0), 1, compensated), dr.mask_t(real)(False)
    assert target.blocks(segment(vector(*start), vector(*end)), no).numpy() == expected


def test_two_sum_loses_nothing(precision):
    real = TYPES[precision][0]
    big, small = real(2.0**30), real(1 + EPSILON[precision])
    total, error = two_sum(big, small)
    assert float(total.numpy()[0]) + float(error.numpy()[0]) == pytest.approx(
        2.0**30 + 1, rel=1e-15
    )
    assert error.numpy()[0] == float(small.numpy()[0]) - (float(total.numpy()[0]) - 2.0**30)


def test_level_of_a_compensated_sphere_keeps_its_digits():
    """Stress 5: near the surface of a ball of radius 1e6, single precision's squares have a
    rounding of 65536.
    """
    vector = ad.Array3f
    heights = np.float32([0.25, 0.5, 3, -0.125])
    p = vector(np.float32([10, -3, 0.5, 40]), heights, np.float32([1, 2, 30, 4]))
    exact = [
        float(x) ** 2 + (float(y) + 1e6) ** 2 + float(z) ** 2 - 1e12 for x, y, z in p.numpy().T
    ]
    # The last sum is rounded
    np.testing.assert_allclose(
        ball(vector, (0, -1e6, 0), 1e6, compensated=True).level(p).numpy(), exact, rtol=4e-7
    )
    assert abs(ball(vector, (0, -1e6, 0), 1e6).level(p).numpy() - exact).max() > 1000


def test_safe_normalize(precision):
    vector = TYPES[precision][1]
    v = vector(np.array([0, 3.0]), np.array([0, 0.0]), np.array([0, -4.0]))
    dr.enable_grad(v)
    unit = safe_normalize(v)
    dr.backward(dr.sum(unit.x))
    np.testing.assert_allclose(
        dr.detach(unit).numpy(), [[0, 0.6], [0, 0], [0, -0.8]], atol=4 * EPSILON[precision]
    )
    np.testing.assert_allclose(dr.grad(v).numpy()[:, 0], 0)
    np.testing.assert_allclose(
        dr.grad(v).numpy()[:, 1], [0.64 / 5, 0, 0.48 / 5], rtol=20 * EPSILON[precision]
    )


CAMERA = "[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 0]\nfov = 45\nresolution = [48, 48]\n"


def test_tangent_ray_goes_straight_through_index_one(load, precision):
    """Stress 1 and 8: glass of index 1 bends nothing, the ray that only just touches it included."""
    text = (
        "ambient = [1, 1, 1]\n"
        + CAMERA.replace("[48, 48]", "[1, 1]").replace("[0, 0,", "[1, 0,")
        + WHITE
    )
    text += (
        "[materials.air]\nrefraction = 1\nior = 1\n"
        + sphere([1, 0, -5], 0.1, "white")
        + sphere([0, 0, 0], 1, "air")
    )
    np.testing.assert_array_equal(render(load(text, precision)).numpy(), 1)
