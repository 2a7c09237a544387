"""Images for PyTorch: the same as Dr.Jit's, and so are the gradients.

Without PyTorch, what does not need its tensors is tested with a stand-in for them.
"""

import sys
from types import SimpleNamespace

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from samples import EPSILON, SCENES

import whitted as wt
from whitted.torch import _parameter

NAMES = "spheres.sphere0.center", "spheres.sphere0.radius"
MISSING = "needs PyTorch: pip install 'whitted[torch]'"


class Tensor:
    """What is asked of a tensor before it is used."""

    def __init__(self, numbers, dtype):
        self.numbers, self.dtype = numbers, dtype

    def numel(self):
        return len(self.numbers)


@pytest.fixture
def stand_in(monkeypatch):
    """In place of PyTorch."""
    torch = SimpleNamespace(Tensor=Tensor, float32="torch.float32", float64="torch.float64")
    monkeypatch.setitem(sys.modules, "torch", torch)
    return torch


def test_without_torch_the_remedy_is_told(load, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(RuntimeError, match=r"install it with: pip install 'whitted\[torch\]'"):
        wt.torch_render(load(SCENES["all"]), {})


@pytest.mark.usefixtures("stand_in")
def test_a_tensor_is_for_one_parameter(load):
    with pytest.raises(KeyError, match=r"'spheres\.\*\.radius' is a pattern, and names are"):
        wt.torch_render(load(SCENES["all"], "single"), {"spheres.*.radius": None})


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        (0, Tensor([1.0, 2], "torch.float64"), "3 x torch.float32, got 2 x torch.float64"),
        (0, Tensor([1.0, 2, 3], "torch.float64"), "3 x torch.float32, got 3 x torch.float64"),
        (0, Tensor([1.0, 2], "torch.float32"), "3 x torch.float32, got 2 x torch.float32"),
        (0, [0, 0, 0], "3 x torch.float32, got \\[0, 0, 0\\]"),
        (0, np.zeros(3), "3 x torch.float32, got array"),
        (1, Tensor([1.0, 2, 3], "torch.float32"), "1 x torch.float32, got 3 x torch.float32"),
    ],
)
@pytest.mark.usefixtures("stand_in")
def test_other_values_than_tensors_of_the_parameters_size_are_refused(load, name, value, message):
    with pytest.raises(ValueError, match=rf"^{NAMES[name]}: expected a tensor of {message}"):
        wt.torch_render(load(SCENES["all"], "single"), {NAMES[name]: value})


@pytest.mark.usefixtures("stand_in")
def test_type_of_tensors_is_that_of_the_scene(load):
    value = Tensor([1.0], "torch.float32")
    with pytest.raises(ValueError, match=r"1 x torch\.float64, got 1 x torch\.float32"):
        wt.torch_render(load(SCENES["all"], "double"), {NAMES[1]: value})


@pytest.mark.usefixtures("stand_in")
def test_unknown_name_is_refused(load):
    with pytest.raises(KeyError, match=r"no parameter 'spheres\.ball\.center'; nearest: spheres"):
        wt.torch_render(load(SCENES["all"]), {"spheres.ball.center": Tensor([0.0] * 3, "")})


def test_flat_numbers_become_a_parameter_that_gradients_pass_through():
    flat = ad.Float64(1, 2, 3)
    dr.enable_grad(flat)
    vector = _parameter(ad.Array3f64, flat)
    np.testing.assert_array_equal(np.ravel(dr.detach(vector)), [1, 2, 3])
    dr.backward(dr.dot(vector, ad.Array3f64(4, 5, 6)))
    np.testing.assert_array_equal(dr.grad(flat), [4, 5, 6])
    number = ad.Float64(7)
    assert _parameter(ad.Float64, number) is number


def test_image_and_gradients_are_the_native_ones(load, precision):
    torch = pytest.importorskip("torch", reason=MISSING)
    scene = load(SCENES["all"], precision)
    kind = torch.float32 if precision == "single" else torch.float64
    own = scene.parameters(*NAMES)
    values = {
        name: torch.tensor(own[name].numpy().ravel().tolist(), dtype=kind, requires_grad=True)
        for name in NAMES
    }
    image = wt.torch_render(scene, values, max_depth=2)
    (image**2).mean().backward()

    dr.enable_grad(own)
    native = wt.render(scene.replace(own), max_depth=2)
    dr.backward(dr.mean(dr.square(native), axis=None))
    np.testing.assert_array_equal(image.detach().numpy(), native.numpy())
    for name in NAMES:
        # The adjoint of the mean of squares is rounded another way, number by number
        own_grad, their_grad = own[name].grad.numpy().ravel(), values[name].grad.numpy().ravel()
        bound = 256 * EPSILON[precision] * abs(own_grad).max()
        np.testing.assert_allclose(their_grad, own_grad, rtol=0, atol=bound)


def test_real_tensor_of_another_type_is_refused(load):
    torch = pytest.importorskip("torch", reason=MISSING)
    value = torch.tensor([1.0, 2.0, 3.0], dtype=torch.float64)
    with pytest.raises(ValueError, match=r"3 x torch\.float32, got 3 x torch\.float64"):
        wt.torch_render(load(SCENES["all"], "single"), {NAMES[0]: value})
