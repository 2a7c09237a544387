"""Derivatives of an image in several directions of parameter space from one kernel."""

import drjit as dr
import numpy as np
import pytest

from whitted import load_scene, parse_scene, render
from whitted.inverse.loss import arrays
from whitted.rendering.samples import DIRECTIONS, Linearised
from whitted.sampling import kernels

CLOUD = """
max_depth = 4
[camera]
position = [0, 0.5, 4]
look_at = [0, 0, 0]
fov = 40
resolution = [20, 20]
[materials.glass]
reflection = 1
refraction = 1
fresnel = true
[materials.tiles]
color = [0.8, 0.7, 0.6]
checker = { color = [0.1, 0.2, 0.3], size = 0.4 }
[[clouds]]
name = "beads"
spheres = [[-0.5, 0, 0, 0.45], [0.5, 0, 0.2, 0.4]]
material = "glass"
[[planes]]
name = "floor"
normal = [0, 1, 0]
offset = 0.6
material = "tiles"
[[lights]]
position = [1, 4, 3]
intensity = [1, 1, 1]
"""


@pytest.mark.parametrize("boundary", [True, False])
@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("which", ["box", "cloud"])
def test_directions_together_are_those_one_by_one(which, precision, boundary):
    """More directions than one kernel takes, and not a multiple of it.

    Kernels add up the same numbers in the same order. The compiler may fuse other products and
    sums; a digit of the derivative of a level function near 0 is the worst.
    """
    scene = parse_scene(CLOUD, precision) if which == "cloud" else load_scene("cornell", precision)
    names = ("camera.position", "materials.glass.ior", "camera.fov")
    names += ("clouds.beads.center",) if which == "cloud" else ("spheres.ball.center",)
    values, size = scene.parameters(*names), {"resolution": (20, 20), "boundary": boundary}
    shapes = [dr.detach(value).numpy().T.shape for value in values.values()]
    rng = np.random.default_rng(3)
    directions = [
        arrays(scene, dict(zip(names, (rng.normal(size=s).tolist() for s in shapes), strict=True)))
        for _ in range(DIRECTIONS + 1)
    ]
    dr.enable_grad(values)
    linearised = Linearised(scene.replace(values), values, spp=4, **size)
    together = linearised.along(directions)
    assert len(together) == len(directions)
    image = render(scene.replace(values), 4, **size)
    np.testing.assert_array_equal(linearised.image.numpy(), image.numpy())
    for direction, found in zip(directions, together, strict=True):
        for name, tangent in direction.items():
            dr.set_grad(values[name], tangent)
        alone = dr.forward_to(image, flags=dr.ADFlag.ClearInterior).numpy()
        dr.clear_grad(image)
        scale = abs(alone).max()
        assert scale > 0.1
        tolerance = 1e-4 if precision == "single" else 1e-10
        np.testing.assert_allclose(found.numpy(), alone, rtol=0, atol=tolerance * scale)


def test_directions_share_kernels(monkeypatch):
    """Six directions take two calls of the kernel of a film, with three each."""
    scene, counts = load_scene("cornell"), []
    values = scene.parameters("spheres.ball.center")
    dr.enable_grad(values)
    linearised = Linearised(scene.replace(values), values, resolution=(8, 8), boundary=False)
    own = kernels.image_jvp

    def counting(*inputs):
        counts.append(len(inputs[5]))
        return own(*inputs)

    monkeypatch.setattr(kernels, "image_jvp", counting)
    units = [arrays(scene, {"spheres.ball.center": unit.tolist()}) for unit in np.eye(3)]
    assert len(linearised.along(units * 2)) == 6
    assert counts == [3, 3]
