"""Where rays meet spheres and planes, at sizes and places where plain formulas lose their digits, in both precisions."""

import math

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from samples import LIGHT, sphere
from samples import render_plain as render

from whitted.geometry import (
    NONE,
    Plane,
    Ray,
    Sphere,
    level,
    plane_blocks,
    plane_distance,
    safe_normalize,
    sphere_blocks,
    sphere_distance,
    two_sum,
)

TYPES = {"single": (ad.Float, ad.Array3f), "double": (ad.Float64, ad.Array3f64)}
EPSILON = {"single": 2.0**-23, "double": 2.0**-52}
WHITE = "[materials.white]\ncolor = [1, 1, 1]\n"


def ball(vector, center, radius, wide=False):
    return Sphere("ball", "", vector(*map(float, center)), dr.value_t(vector)(radius), wide)


def ray_of(o, d, inward=False):
    mask, width = dr.mask_t(o.x), dr.width(o, d)
    uint = dr.uint32_array_t(o.x)
    return Ray(o, d, dr.full(uint, NONE, width), dr.full(mask, inward, width))


def meets(sphere, ray, on=False):
    """Distance, whether the sphere is met, whether from within: as NumPy arrays."""
    return tuple(x.numpy() for x in sphere_distance(sphere, ray, dr.mask_t(ray.inward)(on)))


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("offset", [-1e-3, -1e-6, -1e-7, 0, 1e-7, 1e-6, 1e-3])
def test_tangent_ray(precision, wide, offset):
    """Stress 1: a hit or a miss, the same for the search and for shadows; the search has no gradient, see `test_trace`."""
    real, vector = TYPES[precision]
    for degrees in range(0, 360, 7):
        direction = math.radians(degrees)
        radius, d = real(1), vector(math.cos(direction), math.sin(direction), 0)
        side = vector(-math.sin(direction), math.cos(direction), 0)
        o = -3 * d + side * (1 + offset)
        t, hit, _ = sphere_distance(Sphere("", "", vector(0), radius, wide), ray_of(o, d), dr.mask_t(radius)(False))
        blocks = sphere_blocks(
            ball(vector, (0, 0, 0), 1, wide), o, o + 6 * d, d, real(6), dr.mask_t(d.x)(False), dr.mask_t(d.x)(False)
        )
        assert hit.numpy() == blocks.numpy()
        if abs(offset) > 10 * EPSILON[precision]:
            assert hit.numpy() == (offset < 0)
        if hit.numpy()[0]:
            # sqrt(2 * offset), and of a rounding
            assert t.numpy()[0] == pytest.approx(3, abs=math.sqrt(2 * abs(offset) + 20 * EPSILON[precision]))


@pytest.mark.parametrize("wide", [False, True])
def test_exactly_tangent_ray_is_the_same_to_search_and_shadow(precision, wide):
    """Stress 1."""
    real, vector = TYPES[precision]
    target, o, d, no = ball(vector, (0, 0, 0), 1, wide), vector(3, 1, 0), vector(-1, 0, 0), dr.mask_t(real)(False)
    blocks = sphere_blocks(target, o, o + 6 * d, d, real(6), no, no)
    assert meets(target, ray_of(o, d))[1] == blocks.numpy()


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
    # No rings: away from the rim by a few roundings of a unit's size, a hit is what the distance from the axis says
    squared = x.numpy().astype(float) ** 2 + y.numpy().astype(float) ** 2
    clear = abs(squared - 1) > 10 * EPSILON[precision]
    np.testing.assert_array_equal(hit[clear], squared[clear] < 1)


@pytest.mark.parametrize("distance", [1e2, 1e3, 1e4])
def test_distance_to_a_distant_sphere(precision, distance):
    """Stress 2: the distance's error is a rounding of the distance, not of its square."""
    vector = TYPES[precision][1]
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-0.7, 0.7, (2, 1000)).astype(np.float32)
    t, hit, _ = meets(ball(vector, (0, 0, -distance), 1), ray_of(vector(x, y, np.zeros_like(x)), vector(0, 0, -1)))
    assert hit.all()
    expected = distance - np.sqrt(1 - x.astype(float) ** 2 - y.astype(float) ** 2)
    np.testing.assert_allclose(t, expected, rtol=0, atol=2 * EPSILON[precision] * distance)


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("radius", [1e-4, 1e-2, 1, 1e2, 1e4])
def test_leaving_ones_own_surface(precision, radius, wide):
    """Stress 6: outward there is no hit at all, inward the other end of the chord, at -2 r d . n."""
    real, vector = TYPES[precision]
    rng = np.random.default_rng(6)
    n = rng.normal(size=(3, 10000))
    d = rng.normal(size=(3, 10000))
    n, d = n / np.linalg.norm(n, axis=0), d / np.linalg.norm(d, axis=0)
    center = np.array([0.3, -0.2, 0.5]) * radius
    target = ball(vector, center, radius, wide)
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
    np.testing.assert_allclose(t[inward], -2 * radius * slope[inward], rtol=0, atol=8 * EPSILON[precision] * radius)
    assert (t >= 0).all()


@pytest.mark.parametrize("wide", [False, True])
@pytest.mark.parametrize("radius", [1e-4, 0.5, 3, 1e4])
def test_origin_at_the_center(precision, radius, wide):
    """Stress 7: every direction meets the sphere at its radius, from within."""
    vector = TYPES[precision][1]
    target = ball(vector, (1, -2, 0.5), radius, wide)
    rng = np.random.default_rng(7)
    d = dr.normalize(vector(*rng.normal(size=(3, 100))))
    t, hit, within = meets(target, ray_of(target.center + dr.zeros(vector, 100), d))
    assert hit.all()
    assert within.all()
    np.testing.assert_allclose(t, radius, rtol=4 * EPSILON[precision])


@pytest.mark.parametrize("wide", [False, True])
def test_sphere_behind(precision, wide):
    """Stress 7: a miss."""
    vector = TYPES[precision][1]
    _, hit, _ = meets(ball(vector, (0, 0, 3), 1, wide), ray_of(vector(0.1, 0, 0), vector(0, 0, -1)))
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


@pytest.mark.parametrize("wide", [False, True])
def test_ray_from_within(precision, wide):
    vector = TYPES[precision][1]
    t, hit, within = meets(ball(vector, (0, 0, 0), 2, wide), ray_of(vector(0, 0, 1.5), vector(0, 0, -1)))
    assert (hit.all(), within.all()) == (True, True)
    np.testing.assert_allclose(t, 3.5, rtol=4 * EPSILON[precision])


def test_plane_in_front_behind_and_along(precision):
    real, vector = TYPES[precision]
    floor = Plane("", "", vector(0, 1, 0), real(1))
    o = vector(0.3, 1, 0)
    assert plane_distance(floor, ray_of(o, vector(0, -1, 0))).numpy() == 2
    assert plane_distance(floor, ray_of(o, vector(0, 1, 0))).numpy() == -2
    assert not np.isfinite(plane_distance(floor, ray_of(o, vector(1, 0, 0))).numpy())


def test_plane_blocks_only_between_its_sides(precision):
    real, vector = TYPES[precision]
    floor = Plane("", "", vector(0, 1, 0), real(1))
    for a, b, expected in ((1, -3, True), (-3, 1, True), (1, 2, False), (-3, -2, False), (-1, 2, False), (1, -1, False)):
        assert plane_blocks(floor, vector(0, a, 0), vector(5, b, 0)).numpy() == expected


@pytest.mark.parametrize("wide", [False, True])
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
def test_sphere_blocks(precision, wide, start, end, expected):
    real, vector = TYPES[precision]
    p, light = vector(*start), vector(*end)
    distance = dr.norm(light - p)
    no = dr.mask_t(real)(False)
    assert sphere_blocks(ball(vector, (0, 0, 0), 1, wide), p, light, (light - p) / distance, distance, no, no).numpy() == expected


def test_two_sum_loses_nothing(precision):
    real = TYPES[precision][0]
    big, small = real(2.0**30), real(1 + EPSILON[precision])
    total, error = two_sum(big, small)
    assert float(total.numpy()[0]) + float(error.numpy()[0]) == pytest.approx(2.0**30 + 1, rel=1e-15)
    assert error.numpy()[0] == float(small.numpy()[0]) - (float(total.numpy()[0]) - 2.0**30)


def test_level_of_a_wide_sphere_keeps_its_digits():
    """Stress 5: near the surface of a ball of radius 1e6, single precision's squares have a rounding of 65536."""
    vector = ad.Array3f
    heights = np.float32([0.25, 0.5, 3, -0.125])
    p = vector(np.float32([10, -3, 0.5, 40]), heights, np.float32([1, 2, 30, 4]))
    exact = [float(x) ** 2 + (float(y) + 1e6) ** 2 + float(z) ** 2 - 1e12 for x, y, z in p.numpy().T]
    # The last sum is rounded
    np.testing.assert_allclose(level(ball(vector, (0, -1e6, 0), 1e6, wide=True), p).numpy(), exact, rtol=4e-7)
    assert abs(level(ball(vector, (0, -1e6, 0), 1e6), p).numpy() - exact).max() > 1000


def test_safe_normalize(precision):
    vector = TYPES[precision][1]
    v = vector(np.array([0, 3.0]), np.array([0, 0.0]), np.array([0, -4.0]))
    dr.enable_grad(v)
    unit = safe_normalize(v)
    dr.backward(dr.sum(unit.x))
    np.testing.assert_allclose(dr.detach(unit).numpy(), [[0, 0.6], [0, 0], [0, -0.8]], atol=4 * EPSILON[precision])
    np.testing.assert_allclose(dr.grad(v).numpy()[:, 0], 0)
    np.testing.assert_allclose(dr.grad(v).numpy()[:, 1], [0.64 / 5, 0, 0.48 / 5], rtol=20 * EPSILON[precision])


CAMERA = "[camera]\nposition = [0, 0, 4]\nlook_at = [0, 0, 0]\nfov = 45\nresolution = [48, 48]\n"


def test_tangent_ray_goes_straight_through_index_one(load, precision):
    """Stress 1 and 8: glass of index 1 bends nothing, the ray that only just touches it included."""
    text = "ambient = [1, 1, 1]\n" + CAMERA.replace("[48, 48]", "[1, 1]").replace("[0, 0,", "[1, 0,") + WHITE
    text += "[materials.air]\nrefraction = 1\nior = 1\n" + sphere([1, 0, -5], 0.1, "white") + sphere([0, 0, 0], 1, "air")
    np.testing.assert_array_equal(render(load(text, precision)).numpy(), 1)
