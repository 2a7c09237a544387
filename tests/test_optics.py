"""Reflection, refraction and the Fresnel equations against closed forms, with their derivatives by
Dr.Jit.
"""

import math

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad

from whitted.tracing.optics import fresnel, reflect, refract, transmission

TYPES = {"single": (ad.Float, ad.Array3f), "double": (ad.Float64, ad.Array3f64)}
ROUNDING = {"single": 1e-6, "double": 1e-14}  # a few roundings of numbers near 1


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


def test_mirror(precision):
    vector = TYPES[precision][1]
    d, n = dr.normalize(vector(1, -2, 0.5)), vector(0, 1, 0)
    np.testing.assert_allclose(
        np.ravel(reflect(d, n)), np.ravel(d) * [1, -1, 1], rtol=ROUNDING[precision]
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
            np.testing.assert_allclose(value, textbook(theta, n), rtol=1e-11, atol=1e-15)
            h = 1e-5
            # 1e-16 / 1e-5 of rounding, and truncation of h^2 times the third derivative
            expected = 0 if n == 1 else (textbook(theta, n + h) - textbook(theta, n - h)) / (2 * h)
            np.testing.assert_allclose(by_n, expected, rtol=1e-5, atol=1e-10)


@pytest.mark.parametrize("inside", [1e-3, 1e-4, 1e-5, 1e-6])
def test_just_inside_the_critical_angle(inside):
    """Stress 11: R = 1 - 2 (n + 1 / n) cos_t / cos_i to first order in cos_t, so that its slope
    grows as 1 / sqrt.
    """
    theta = math.asin(1 / 1.5) - inside
    value, by_n = slope(lambda n: interface(ad.Float64(math.cos(theta)), n)[0], ad.Float64(1 / 1.5))
    cos_i, cos_t = math.cos(theta), math.sqrt(1 - (1.5 * math.sin(theta)) ** 2)
    factor = 2 * (1.5 + 1 / 1.5) / cos_i
    # The terms left out are of the size of cos_t, relative to those that are here
    assert (1 - value) / (factor * cos_t) == pytest.approx(1, abs=4 * cos_t)
    by_n_expected = -factor * (1.5 * math.sin(theta)) ** 2 * 1.5 / cos_t
    assert by_n / by_n_expected == pytest.approx(1, abs=8 * cos_t)


def test_index_one(precision):
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


def test_reflectance_is_between_0_and_1(precision):
    real = TYPES[precision][0]
    rng = np.random.default_rng(0)
    cosine, n = real(rng.uniform(0, 1, 10000) ** 3), real(np.exp(rng.uniform(-2, 2, 10000)))
    reflectance = interface(cosine, n)[0].numpy()
    assert reflectance.min() >= 0
    assert reflectance.max() <= 1 + ROUNDING[precision]


def test_refracted_direction_obeys_snell(precision):
    real, vector = TYPES[precision]
    for degrees in (0, 10, 45, 80, 89):
        theta = math.radians(degrees)
        d, normal = vector(math.sin(theta), -math.cos(theta), 0), vector(0, 1, 0)
        cosine = -dr.dot(d, normal)
        out = refract(d, normal, cosine, interface(cosine, real(1.5))[2], 1 / real(1.5))
        x, y, z = np.ravel(out.numpy()).tolist()
        tolerance = 3 * ROUNDING[precision]
        assert (x, z) == (pytest.approx(math.sin(theta) / 1.5, abs=tolerance), 0)
        assert y == pytest.approx(-math.sqrt(1 - (math.sin(theta) / 1.5) ** 2), abs=tolerance)
