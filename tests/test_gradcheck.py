"""The gradient checker notices a derivative that is wrong by 0.1 %, in either mode, and ignores
jumps.
"""

import drjit as dr
import pytest
from drjit.llvm import ad
from gradcheck import adjoint_error, compare, directions

VALUES = {"a": ad.Float64(0.7), "b": ad.Array3f64(0.3, -0.4, 1.1)}


class Wave(dr.CustomOp):
    """sin(3 a) cos(x . b) at some x, with derivatives that can be made wrong."""

    def eval(self, a, b, forward, reverse):
        self.inputs, self.factors = (a, b), (forward, reverse)
        return dr.sin(3 * a) * dr.cos(self.phase())

    def phase(self):
        self.x = dr.arange(ad.Float64, 48) / 20
        return self.x * (self.inputs[1].x + 2 * self.inputs[1].y + self.x * self.inputs[1].z)

    def slopes(self):
        a, phase = self.inputs[0], self.phase()
        by_phase = -dr.sin(3 * a) * dr.sin(phase)
        return 3 * dr.cos(3 * a) * dr.cos(phase), by_phase * ad.Array3f64(
            self.x, 2 * self.x, self.x * self.x
        )

    def forward(self):
        by_a, by_b = self.slopes()
        self.set_grad_out(
            self.factors[0] * (by_a * self.grad_in("a") + dr.dot(by_b, self.grad_in("b")))
        )

    def backward(self):
        by_a, by_b = self.slopes()
        out = self.grad_out()
        self.set_grad_in("a", dr.sum(by_a * out))
        self.set_grad_in("b", self.factors[1] * ad.Array3f64(*(dr.sum(c * out) for c in by_b)))


def wave(forward=1.0, reverse=1.0):
    return lambda values: ad.TensorXf64(
        dr.custom(Wave, values["a"], values["b"], forward, reverse), (4, 4, 3)
    )


def test_right_derivatives_pass():
    compared = compare(wave(), VALUES, directions(VALUES))
    assert compared.smooth.all()
    # Roundings of 1e-16 over a step of 1e-5; some 5 of them add up
    assert compared.error < 1e-10
    # 48 terms
    assert adjoint_error(wave(), VALUES, directions(VALUES)) < 48 * 2.0**-52


@pytest.mark.parametrize("wrong", [0.999, 1.001])
def test_forward_derivative_wrong_by_a_thousandth_is_caught(wrong):
    # 0.001 of the derivative, where that is largest
    assert compare(wave(forward=wrong), VALUES, directions(VALUES)).error > 9e-4
    # In a sum of both signs a thousandth of it is less of the moduli, and far above roundings
    assert adjoint_error(wave(forward=wrong), VALUES, directions(VALUES)) > 1e-5


@pytest.mark.parametrize("wrong", [0.999, 1.001])
def test_reverse_derivative_wrong_by_a_thousandth_is_caught(wrong):
    assert adjoint_error(wave(reverse=wrong), VALUES, directions(VALUES)) > 1e-5


def test_jumps_and_kinks_are_left_out():
    """The jump passes the number at 0.7 when a moves, the kink that at 0.3 when b.x does."""

    def image(values):
        x = dr.arange(ad.Float64, 12) / 10
        jump, kink = dr.select(x < values["a"], 1, 0), abs(x - values["b"].x)
        return ad.TensorXf64(jump + kink + dr.sin(values["a"] * x), (2, 2, 3))

    compared = compare(image, VALUES, directions(VALUES))
    assert [k for k, smooth in enumerate(compared.smooth.ravel()) if not smooth] == [3, 7]
    # Roundings of 1e-16 over a step of 1e-5, relative to slopes near 1
    assert compared.error < 1e-10
