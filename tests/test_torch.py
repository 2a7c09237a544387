"""Images for PyTorch: the same as Dr.Jit's, and so are the gradients."""

import sys

import drjit as dr
import numpy as np
import pytest
from samples import SCENES

import whitted as wt

NAMES = "spheres.sphere0.center", "spheres.sphere0.radius"


def test_without_torch(load, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(RuntimeError, match=r"install it with: pip install 'whitted\[torch\]'"):
        wt.torch_render(load(SCENES["all"]), {})


def test_image_and_gradients_are_the_native_ones(load, precision):
    torch = pytest.importorskip("torch")
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
        np.testing.assert_allclose(
            values[name].grad.numpy().ravel(), own[name].grad.numpy().ravel(), rtol=1e-4
        )


@pytest.mark.parametrize(
    ("value", "match"),
    [
        ([1.0, 2.0], "got 2 x torch.float64"),
        ([1.0, 2.0, 3.0], "expected a tensor of 3 x torch.float32, got 3 x torch.float64"),
    ],
)
def test_other_tensors_are_refused(load, value, match):
    torch = pytest.importorskip("torch")
    with pytest.raises(ValueError, match=match):
        wt.torch_render(
            load(SCENES["all"], "single"), {NAMES[0]: torch.tensor(value, dtype=torch.float64)}
        )
    with pytest.raises(ValueError, match=r"got \[0, 0, 0\]"):
        wt.torch_render(load(SCENES["all"], "single"), {NAMES[0]: [0, 0, 0]})
