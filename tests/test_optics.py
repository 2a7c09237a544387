"""Reflection, refraction and the Fresnel equations against closed forms, with their derivatives by
Dr.Jit.
"""

import math

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from hypothesis import given
from samples import EPSILON
from strategies import reals, vectors

from whitted.core.host import to_lanes
from whitted.tracing.optics import fresnel, reflect, refract, transmission

TYPES = {"single": (ad.Float, ad.Array3f), "double": (ad.Float64, ad.Array3f64)}


def interface(cosine, n):
    """Reflectance where light in air meets an index n, whether it is total, and the refracted
    cosine.
    """
    eta = 1 / n
    squared, total = transmission(cosine, eta)
    cos_theta_t = dr.select(squared > 0, dr.sqrt(dr.select(squared > 0, squared, 1)), 0)
    return dr.select(total, 1, fresnel(cosine, cos_theta_t, eta)), total, cos_theta_t


def slope(function, x):
    """A function's value and derivative at x."""
    x = type(x)(x)
    dr.enable_grad(x)
    y = function(x)
    dr.set_grad(x, 1)
    dr.enqueue(dr.ADMode.Forward, x)
    dr.traverse(dr.ADMode.Forward)
    return dr.detach(y).numpy(), dr.grad(y).numpy()


def test_mirror_turns_the_normal_component_around(precision):
    vector = TYPES[precision][1]
    d, n = dr.normalize(vector(1, -2, 0.5)), vector(0, 1, 0)
    # Exact but for the product 2 (d . n) and the sum
    np.testing.assert_allclose(
        np.ravel(reflect(d, n)), np.ravel(d) * [1, -1, 1], rtol=2 * EPSILON[precision]
    )


@pytest.mark.parametrize("n", [0.6, 0.9, 1.0, 1.2, 1.5, 2.4])
def test_reflectance_and_its_derivative_are_the_textbooks(n):
    """By angles: R_s = (sin(ti - tt) / sin(ti + tt))^2, R_p = (tan(ti - tt) / tan(ti + tt))^2; d/dn
    by differences.
    """

    def textbook(theta, n):
        if n == 1:
            return 0.0
        t = math.asin(math.sin(theta) / n)
        s, p = math.sin(theta - t) / math.sin(theta + t), math.tan(theta - t) / math.tan(theta + t)
        return (s * s + p * p) / 2

    for degrees in (5, 20, 35, 36.5, 60, 75, 85):
        theta = math.radians(degrees)
        if math.sin(theta) < 0.99 * n:
            value, by_n = slope(
                lambda n, theta=theta: interface(ad.Float64(math.cos(theta)), n)[0], ad.Float64(n)
            )
            # Both subtract sines and products near each other, which magnifies roundings some
            # hundredfold; at n = 1 all is 0
            np.testing.assert_allclose(value, textbook(theta, n), rtol=1e-13, atol=1e-15)
            # Truncation is largest near the critical index, from which n is 0.01 away at least:
            # (h / 0.01)^2 = 1e-6. Rounding is 1e-16 / h = 1e-11, some of them 1e-10
            h = 1e-5
            expected = 0 if n == 1 else (textbook(theta, n + h) - textbook(theta, n - h)) / (2 * h)
            np.testing.assert_allclose(by_n, expected, rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize("inside", [1e-3, 1e-4, 1e-5, 1e-6])
def test_slope_just_inside_the_critical_angle_is_that_of_the_expansion(inside):
    """Stress 11: R = 1 - 2 (n + 1 / n) cos_t / cos_i to first order in cos_t, so that its slope
    grows as 1 / sqrt.
    """
    theta = math.asin(1 / 1.5) - inside
    value, by_n = slope(lambda n: interface(ad.Float64(math.cos(theta)), n)[0], ad.Float64(1 / 1.5))
    cos_i, cos_t = math.cos(theta), math.sqrt(1 - (1.5 * math.sin(theta)) ** 2)
    factor = 2 * (1.5 + 1 / 1.5) / cos_i
    # 1 - R is the mean of 4 x - 8 x^2 + ... at x = cos_t / (n cos_i) and x = n cos_t / cos_i; here
    # the second term is 3.34 cos_t of the first, and twice that after differentiation
    assert (1 - value) / (factor * cos_t) == pytest.approx(1, abs=4 * cos_t)
    by_n_expected = -factor * (1.5 * math.sin(theta)) ** 2 * 1.5 / cos_t
    assert by_n / by_n_expected == pytest.approx(1, abs=8 * cos_t)


def test_index_one_does_nothing(precision):
    """Stress 8: no reflectance, no derivative by n, no bend, never total, to grazing incidence and
    at it.
    """
    real, vector = TYPES[precision]
    # All that single precision can square, and 0
    cosines = np.concatenate([np.linspace(0, 1, 1001), 2.0 ** -np.arange(1, 60)])
    cosine = real(cosines)
    n = dr.ones(real, len(cosines))
    dr.enable_grad(n)
    reflectance, total, _ = interface(cosine, n)
    dr.set_grad(n, 1)
    dr.enqueue(dr.ADMode.Forward, n)
    dr.traverse(dr.ADMode.Forward)
    np.testing.assert_array_equal(dr.detach(reflectance).numpy(), 0)
    np.testing.assert_array_equal(dr.grad(reflectance).numpy(), 0)
    assert not np.any(total.numpy())
    squared, _ = transmission(cosine, real(1))
    np.testing.assert_array_equal(squared.numpy(), (cosine * cosine).numpy())
    d = vector(dr.sqrt(1 - cosine * cosine), -cosine, 0)
    bent = refract(d, vector(0, 1, 0), cosine, cosine, real(1))
    np.testing.assert_array_equal(bent.numpy(), d.numpy())


def lanes(precision, x):
    """Numbers as a Dr.Jit array that kernels do not know."""
    return to_lanes(x.astype(f"f{4 if precision == 'single' else 8}"))


@given(reals(0, 1), reals(-2, 2))
def test_reflectance_is_between_0_and_1(precision, cosine, log_n):
    cosine, n = lanes(precision, cosine), lanes(precision, np.exp(log_n))
    reflectance = interface(cosine, n)[0].numpy()
    assert reflectance.min() >= 0
    # Exactly: |a - b| <= a + b also holds for rounded sums
    assert reflectance.max() <= 1


@given(vectors(units=True), vectors(units=True), reals(-1, 1))
def test_light_that_turns_back_goes_the_way_that_it_came(precision, d, n, log_index):
    """Refraction is reciprocal: there and back gives the same direction, and the same reflectance.

    Were eta the wrong way round on the way back, or the cosines mixed up, this would fail.
    """
    vector, index = TYPES[precision][1], lanes(precision, np.exp(log_index))
    d, n = (dr.normalize(vector(*(lanes(precision, x) for x in rows))) for rows in (d, n))
    n = dr.mulsign(n, -dr.dot(d, n))
    cos_i = dr.fmax(-dr.dot(d, n), 0)
    reflectance, total, cos_t = interface(cos_i, index)
    onward = refract(d, n, cos_i, cos_t, 1 / index)

    back_i = dr.dot(-onward, n)
    back_reflectance, _, back_t = interface(back_i, 1 / index)
    back = refract(-onward, -n, back_i, back_t, index)
    off, differs = dr.norm(back + d), abs(reflectance - back_reflectance)
    dr.eval(off, differs, total, cos_i, cos_t)
    off, differs, passed = off.numpy(), differs.numpy(), ~total.numpy()
    grazing = np.minimum(cos_i.numpy(), cos_t.numpy())
    # A cosine is the root of a difference of numbers up to the square of the index, below 7.4, with
    # some 8 roundings of those; the root magnifies them by the cosine's reciprocal
    rounding = 8 * 7.4 * EPSILON[precision] / np.maximum(grazing, 1e-30)
    clear = passed & (rounding < 0.1 * grazing)
    assert (off[clear] <= rounding[clear]).all()
    # The reflectance falls with the cosine by no more than 4 n, n up to 2.7
    assert (differs[clear] <= 11 * rounding[clear]).all()


def test_refracted_direction_obeys_snell(precision):
    real, vector = TYPES[precision]
    for degrees in (0, 10, 45, 80, 89):
        theta = math.radians(degrees)
        d, normal = vector(math.sin(theta), -math.cos(theta), 0), vector(0, 1, 0)
        cosine = -dr.dot(d, normal)
        out = refract(d, normal, cosine, interface(cosine, real(1.5))[2], 1 / real(1.5))
        x, y, z = np.ravel(out.numpy()).tolist()
        # Sine and cosine of the angle are rounded, and so are six operations with numbers up to 1.5
        rounding = 8 * EPSILON[precision]
        assert (x, z) == (pytest.approx(math.sin(theta) / 1.5, abs=rounding), 0)
        assert y == pytest.approx(-math.sqrt(1 - (math.sin(theta) / 1.5) ** 2), abs=rounding)
