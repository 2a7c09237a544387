"""Where rays meet spheres, planes and discs, at sizes and places where plain formulas lose their
digits, in both precisions.
"""

import math
from dataclasses import replace
from fractions import Fraction

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from hypothesis import given
from hypothesis import strategies as st
from samples import EPSILON, LIGHT, camera, keys, material, sphere
from samples import render_plain as render
from strategies import RAYS, powers, vectors

from whitted.core.host import to_lanes
from whitted.core.numerics import two_sum
from whitted.core.ray import NONE, Ray, ShadowRay
from whitted.shapes import Disc, Plane, Sphere

TYPES = {"single": (ad.Float, ad.Array3f), "double": (ad.Float64, ad.Array3f64)}
WHITE = material("white", color=[1, 1, 1])
CAMERA = camera([0, 0, 4], fov=45, resolution=(48, 48))


def ball(vector, center, radius, compensated=False):
    return Sphere(
        "ball", "", vector(*map(float, center)), dr.value_t(vector)(radius), compensated=compensated
    )


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
def test_ray_near_a_tangent_meets_or_misses_the_same_to_search_and_shadow(
    precision, compensated, offset
):
    """Stress 1: a line that passes a sphere at a distance of 1 + offset radii meets it or not, and
    the search and the shadow test agree on that.
    """
    real, vector = TYPES[precision]
    for degrees in range(0, 360, 7):
        direction = math.radians(degrees)
        radius, d = real(1), vector(math.cos(direction), math.sin(direction), 0)
        side = vector(-math.sin(direction), math.cos(direction), 0)
        o = -3 * d + side * (1 + offset)
        target, no = (
            Sphere("", "", vector(0), radius, compensated=compensated),
            dr.mask_t(radius)(False),
        )
        t, hit, _ = target.distance(ray_of(o, d), no)
        beyond = ShadowRay(o, d, real(6), o + 6 * d, dr.uint32_array_t(real)(NONE), no)
        assert hit.numpy() == target.blocks(beyond, no).numpy()
        # Origin, direction and their products have some 10 roundings of numbers up to 3
        if abs(offset) > 10 * EPSILON[precision]:
            assert hit.numpy() == (offset < 0)
        if hit.numpy()[0]:
            # Half the chord is sqrt(-2 offset); the offset is rounded by 10 roundings, as is above
            half = math.sqrt(2 * abs(offset) + 20 * EPSILON[precision])
            assert t.numpy()[0] == pytest.approx(3, abs=half)


@pytest.mark.parametrize("compensated", [False, True])
def test_exactly_tangent_ray_is_the_same_to_search_and_shadow(precision, compensated):
    """Stress 1: both miss the sphere, or both meet it."""
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
def test_silhouette_of_a_distant_sphere_is_a_disc(precision, distance):
    """Stress 2: a unit sphere covers pi of parallel rays, without rings."""
    real, vector = TYPES[precision]
    side = 2000
    at = (np.arange(side) + 0.5) / side * 2.2 - 1.1
    x, y = (real(a.ravel()) for a in np.meshgrid(at, at))
    o, d = vector(x, y, real(0)), vector(0, 0, -1)
    _, hit, _ = meets(ball(vector, (0, 0, -distance), 1), ray_of(o, d))
    # The number of grid points in a circle of R = 909 cells differs from its area by about R^(2/3)
    # (Gauss's circle problem): 94 of 2.6 million, 4e-5
    assert hit.sum() * (2.2 / side) ** 2 == pytest.approx(math.pi, rel=1e-4)
    # No rings: farther from the rim than 10 roundings of 1, a hit is what the distance from the
    # axis says
    squared = x.numpy().astype(float) ** 2 + y.numpy().astype(float) ** 2
    clear = abs(squared - 1) > 10 * EPSILON[precision]
    np.testing.assert_array_equal(hit[clear], squared[clear] < 1)


@pytest.mark.parametrize("distance", [1e2, 1e3, 1e4])
def test_distance_to_a_distant_sphere_is_right_to_a_rounding(precision, distance):
    """Stress 2: the distance's error is a rounding of the distance, not of its square."""
    vector = TYPES[precision][1]
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-0.7, 0.7, (2, 1000)).astype(np.float32)
    t, hit, _ = meets(
        ball(vector, (0, 0, -distance), 1), ray_of(vector(x, y, np.zeros_like(x)), vector(0, 0, -1))
    )
    assert hit.all()
    # Two roundings of the distance: that of the chord's middle, and that of the difference
    expected = distance - np.sqrt(1 - x.astype(float) ** 2 - y.astype(float) ** 2)
    np.testing.assert_allclose(t, expected, rtol=0, atol=2 * EPSILON[precision] * distance)


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize("radius", [1e-4, 1e-2, 1, 1e2, 1e4])
def test_ray_from_the_surface_meets_the_sphere_only_inward(precision, radius, compensated):
    """Stress 6: a ray that leaves outward meets the sphere nowhere, and one that leaves inward at
    the other end of the chord, at -2 r d . n.
    """
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
    # Twice four roundings of a radius: of the origin's coordinates and of their products with d
    np.testing.assert_allclose(
        t[inward], -2 * radius * slope[inward], rtol=0, atol=8 * EPSILON[precision] * radius
    )
    assert (t >= 0).all()


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize("radius", [1e-4, 0.5, 3, 1e4])
def test_rays_from_the_center_meet_the_sphere_at_its_radius(precision, radius, compensated):
    """Stress 7: every direction meets the sphere at its radius, from within."""
    vector = TYPES[precision][1]
    target = ball(vector, (1, -2, 0.5), radius, compensated)
    rng = np.random.default_rng(7)
    d = dr.normalize(vector(*rng.normal(size=(3, 100))))
    t, hit, within = meets(target, ray_of(target.center + dr.zeros(vector, 100), d))
    assert hit.all()
    assert within.all()
    # A square, a sum, a root and a sum
    np.testing.assert_allclose(t, radius, rtol=4 * EPSILON[precision])


@pytest.mark.parametrize("compensated", [False, True])
def test_sphere_behind_is_missed(precision, compensated):
    """Stress 7: the line meets the sphere, but the ray goes away from it."""
    vector = TYPES[precision][1]
    _, hit, _ = meets(
        ball(vector, (0, 0, 3), 1, compensated), ray_of(vector(0.1, 0, 0), vector(0, 0, -1))
    )
    assert not hit.any()


def test_sphere_behind_has_no_gradient(load, precision):
    """Stress 7: a square root behind a `select` could make it NaN."""
    text = keys(background=[1, 1, 1], ambient=[1, 1, 1]) + CAMERA + WHITE + LIGHT
    scene = load(text + sphere([0, 0, 9], 1, "white"), precision)
    params = scene.parameters("spheres.sphere0.center", "spheres.sphere0.radius")
    dr.enable_grad(params)
    image = render(scene.replace(params))
    dr.backward(dr.sum(image.array))
    np.testing.assert_array_equal(dr.detach(image).numpy(), 1)
    for value in params.values():
        np.testing.assert_array_equal(dr.grad(value).numpy(), 0)


@pytest.mark.parametrize("compensated", [False, True])
def test_ray_from_within_meets_the_far_side(precision, compensated):
    vector = TYPES[precision][1]
    t, hit, within = meets(
        ball(vector, (0, 0, 0), 2, compensated), ray_of(vector(0, 0, 1.5), vector(0, 0, -1))
    )
    assert (hit.all(), within.all()) == (True, True)
    # A square, a sum, a root and a sum
    np.testing.assert_allclose(t, 3.5, rtol=4 * EPSILON[precision])


def test_distance_to_a_plane_in_front_behind_and_along(precision):
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


def test_side_of_the_eye_is_that_of_all_surfaces_behind_no_glass(precision):
    """Also where rounding puts a point beyond the plane; of glass, each point's own side counts."""
    real, vector = TYPES[precision]
    floor, no = Plane("", "wood", vector(0, 1, 0), real(1)), dr.mask_t(real)(False)
    below = segment(vector(0, -1 - 1e-6, 0), vector(5, 2, 0))
    assert floor.blocks(below, no).numpy()
    from_above = replace(below, eye=vector(0, 3, 0))
    assert not floor.blocks(from_above, no).numpy()
    assert floor.blocks(replace(from_above, clear=frozenset({"wood"})), no).numpy()
    assert replace(floor, under_eye=True).blocks(from_above, no).numpy()
    rim = Disc("", "wood", vector(0, -1, 0), vector(0, 1, 0), real(9))
    assert rim.blocks(from_above, no).numpy()


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
def test_sphere_blocks_segments_that_cross_it(precision, compensated, start, end, expected):
    real, vector = TYPES[precision]
    target, no = ball(vector, (0, 0, 0), 1, compensated), dr.mask_t(real)(False)
    assert target.blocks(segment(vector(*start), vector(*end)), no).numpy() == expected


# Any rays, any spheres, planes and discs: Hypothesis draws 16 rays at once


def lanes(precision, rows):
    """Numbers of shape (16,) or (3, 16) as a Dr.Jit array that kernels do not know."""
    columns = [to_lanes(row.astype(f"f{4 if precision == 'single' else 8}")) for row in rows]
    return TYPES[precision][1](*columns) if len(columns) == 3 else columns[0]


def alike(precision, *numbers):
    """One number or one vector, the same in all lanes."""
    return lanes(precision, np.outer(numbers, np.ones(RAYS)))


def exactly(*values):
    """The numbers of Dr.Jit arrays in double precision, all from one kernel."""
    dr.eval(values)
    arrays = [x.numpy() for x in values]
    return [a.astype(float) if a.dtype == np.float32 else a for a in arrays]


def dot(a, b):
    return np.sum(a * b, axis=0)


@st.composite
def spheres(draw):
    """Center, radius, and the size of what is around it."""
    radius, far = draw(powers(-4, 4)), draw(st.sampled_from([1, 30]))
    center = draw(st.tuples(*[st.integers(-100, 100)] * 3))
    return np.array(center) / 100 * far * radius, radius, far * radius


@pytest.mark.parametrize("compensated", [False, True])
@given(spheres(), vectors(), vectors(units=True), vectors(units=True))
def test_ray_that_leaves_a_sphere_outward_never_meets_it_again(
    precision, compensated, sphere, o, d, onward
):
    """A ray that goes inward meets it again, at a point that is as far from the center.

    The rays leave from where others have met the sphere, wherever rounding has put that point.
    Were the surface excluded by a distance instead of by algebra, a small or a large radius would
    fail.
    """
    center, radius, size = sphere
    target = Sphere(
        "", "", alike(precision, *center), alike(precision, radius), compensated=compensated
    )
    o, d, onward = (lanes(precision, rows) for rows in (o * size + center[:, None], d, onward))
    no = dr.mask_t(target.radius)(False)
    t, hit, _ = target.distance(ray_of(o, d), no)
    p = dr.fma(d, t, o)

    outward = dr.mulsign(onward, dr.dot(onward, p - target.center))
    _, again, _ = target.distance(ray_of(p, outward), ~no)
    there, inner, _ = target.distance(ray_of(p, -outward, inward=True), ~no)
    q = dr.fma(-outward, there, p)
    before, after = dr.norm(p - target.center), dr.norm(q - target.center)
    hit, again, inner, there, before, after = exactly(hit, again, inner, there, before, after)
    assert not again[hit].any()
    assert inner[hit].all()
    assert (there[hit] >= 0).all()
    # The chord's ends are as far from the center as each other, whatever the radius: 8 roundings of
    # the coordinates between
    assert (abs(after - before)[hit] <= 8 * EPSILON[precision] * (size + radius)).all()


@pytest.mark.parametrize("compensated", [False, True])
@given(spheres(), vectors(), vectors())
def test_search_and_shadow_test_agree(precision, compensated, sphere, a, b):
    """A sphere keeps a light away exactly where a ray to the light would meet it first."""
    center, radius, size = sphere
    target = Sphere(
        "", "", alike(precision, *center), alike(precision, radius), compensated=compensated
    )
    a, b = (lanes(precision, rows * size + center[:, None]) for rows in (a, b))
    ray, no = segment(a, b), dr.mask_t(target.radius)(False)
    t, hit, _ = target.distance(ray_of(ray.o, ray.d), no)
    found = hit & (t < ray.distance)
    levels = target.level(a), target.level(b)
    told = found, target.blocks(ray, no), ray.distance, *levels
    found, blocked, distance, *levels = exactly(*told)
    # An end that is on the sphere, but for 16 roundings of squares of its coordinates, is on no
    # side of it
    rounding = 16 * EPSILON[precision] * (np.linalg.norm(center) + 2 * size + radius) ** 2
    clear = (np.minimum(*map(abs, levels)) > rounding) & (distance > 0)
    np.testing.assert_array_equal(found[clear], blocked[clear])


@given(spheres(), vectors(units=True), vectors(), vectors())
def test_disc_is_met_where_its_plane_is_met_within_the_radius(precision, sphere, normal, a, b):
    """So by the search and by the shadow test; the distance is that to the plane."""
    center, radius, size = sphere
    disc = Disc(
        "",
        "",
        alike(precision, *center),
        alike(precision, *normal[:, 0]),
        alike(precision, radius),
    )
    plane = Plane("", "", disc.normal, -dr.dot(disc.normal, disc.center))
    a, b = (lanes(precision, rows * size + center[:, None]) for rows in (a, b))
    ray, no = segment(a, b), dr.mask_t(disc.radius)(False)
    t, hit, _ = disc.distance(ray_of(ray.o, ray.d), no)
    t_plane, hit_plane, _ = plane.distance(ray_of(ray.o, ray.d), no)
    shadows = disc.blocks(ray, no), plane.blocks(ray, no)
    told = t, hit, t_plane, hit_plane, *shadows, dr.dot(disc.normal, ray.d), ray.distance
    t, hit, t_plane, hit_plane, shadow, shadow_plane, cosine, distance = exactly(*told)
    vectors = ray.o, ray.d, disc.center, disc.normal
    o, d, middle, normal = (x.numpy().astype(float) for x in vectors)

    # Plain formulas in double precision. A distance is a length over the cosine of the ray and the
    # normal, with 32 roundings of either; what is decided by less, or along the plane, is left open
    extent = np.linalg.norm(center) + 2 * size + radius
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = dot(normal, middle - o) / dot(normal, d)
        rounding = 32 * EPSILON[precision] * extent / cosine**2
        off = np.linalg.norm(o + exact * d - middle, axis=0) - radius
        along = abs(cosine) < 320 * EPSILON[precision]
        clear = ~along & (abs(exact) > rounding) & (abs(off) > rounding)
        ends = clear & (abs(exact - distance) > rounding)
    np.testing.assert_array_equal(hit[clear], (exact > 0)[clear] & (off < 0)[clear])
    np.testing.assert_array_equal(hit[clear], hit_plane[clear] & (off < 0)[clear])
    np.testing.assert_array_equal(shadow[ends], shadow_plane[ends] & (off < 0)[ends])
    np.testing.assert_array_equal(shadow[ends], (hit & (t < distance))[ends])
    for found in (t, t_plane):
        assert (abs(found[clear] - exact[clear]) <= rounding[clear]).all()


def test_two_sum_loses_nothing(precision):
    real = TYPES[precision][0]
    big, small = real(2.0**30), real(1 + EPSILON[precision])
    total, error = two_sum(big, small)
    exact = [Fraction(float(x.numpy()[0])) for x in (big, small, total, error)]
    assert exact[0] + exact[1] == exact[2] + exact[3]
    assert exact[3] != 0


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
    # The last sum is rounded, and so are the errors that it adds
    careful = ball(vector, (0, -1e6, 0), 1e6, compensated=True).level(p).numpy()
    np.testing.assert_allclose(careful, exact, rtol=2 * EPSILON["single"])
    assert abs(ball(vector, (0, -1e6, 0), 1e6).level(p).numpy() - exact).max() > 1000


def test_tangent_ray_goes_straight_through_index_one(load, precision):
    """Stress 1 and 8: glass of index 1 bends nothing, not even the ray that just touches it.

    The one pixel looks along x = 1 past a glass of radius 1, at a white ball.
    """
    text = (
        keys(ambient=[1, 1, 1])
        + camera([1, 0, 4], [1, 0, 0], fov=45, resolution=(1, 1))
        + WHITE
        + material("air", refraction=1, ior=1)
        + sphere([1, 0, -5], 0.1, "white")
        + sphere([0, 0, 0], 1, "air")
    )
    np.testing.assert_array_equal(render(load(text, precision)).numpy(), 1)
