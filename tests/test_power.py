"""Powers of cosines."""

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from samples import EPSILON

from whitted.core.power import power

REALS = {"single": ad.Float, "double": ad.Float64}


@pytest.mark.parametrize("exponent", [0.01, 1, 50, 1000, 1e6])
def test_power_is_that_of_numpy(precision, exponent):
    """The error of a power is that of its logarithm, times the power's own logarithm."""
    real = REALS[precision]
    steps = np.random.default_rng(3).random(1000)
    cosine = real(np.concatenate([steps, 1 - steps / 100, [1, 0.5, np.sqrt(0.5), 1e-20]]))
    exact = cosine.numpy().astype(float) ** float(real(exponent).numpy()[0])
    found = power(cosine, real(exponent)).numpy()
    np.testing.assert_allclose(found, exact, atol=3 * EPSILON[precision])


def test_power_of_what_is_no_cosine_above_zero(precision):
    """It is 0, and 0 where the result is too small for a number; rounding may exceed 1."""
    real = REALS[precision]
    cosine = real([-1, 0, 0.5, 1 + 2 * EPSILON[precision]])
    found = power(cosine, real([50, 50, 1e5, 0.5])).numpy()
    np.testing.assert_allclose(found, [0, 0, 0, 1], atol=2 * EPSILON[precision])
    np.testing.assert_array_equal(found[:2], 0)


def test_derivatives_of_power(precision):
    real = REALS[precision]
    cosine, exponent = real([0.9, -0.5]), real([5, 5])
    dr.enable_grad(cosine, exponent)
    dr.backward(dr.sum(power(cosine, exponent)))
    by_cosine, by_exponent = 5 * 0.9**4, 0.9**5 * np.log(0.9)
    tolerance = 50 * EPSILON[precision]
    np.testing.assert_allclose(dr.grad(cosine).numpy(), [by_cosine, 0], rtol=tolerance)
    np.testing.assert_allclose(dr.grad(exponent).numpy(), [by_exponent, 0], rtol=tolerance)
