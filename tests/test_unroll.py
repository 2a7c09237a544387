"""Levels of the tree of rays as straight code, in front of a loop or without one."""

import drjit as dr
import numpy as np
import pytest

from whitted import gradient, load_scene, parse_scene, render
from whitted.rendering.job import Job

# Two mirrors that see each other: chains
CHAIN = """
max_depth = 7
ambient = [0.1, 0.1, 0.1]
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
fov = 50
resolution = [24, 24]
[materials.mirror]
color = [0.2, 0.1, 0.1]
reflection = 0.8
[[spheres]]
center = [-0.8, 0, 0]
radius = 0.7
material = "mirror"
[[spheres]]
center = [0.8, 0, 0]
radius = 0.7
material = "mirror"
[[planes]]
normal = [0, 1, 0]
offset = 0.8
material = "mirror"
[[lights]]
position = [1, 3, 4]
intensity = [0.8, 0.8, 0.8]
"""
# The eye stands between two mirrors, and sees a wall behind many reflections
CORRIDOR = """
max_depth = 11
ambient = [0.1, 0.1, 0.1]
[camera]
position = [0, 0, 0]
look_at = [0.35, 0.05, -1]
fov = 50
resolution = [8, 8]
[materials.m]
color = [0.1, 0.1, 0.1]
reflection = 0.95
[materials.wall]
color = [0.6, 0.3, 0.2]
[[planes]]
normal = [1, 0, 0]
offset = 1
material = "m"
[[planes]]
normal = [-1, 0, 0]
offset = 1
material = "m"
[[planes]]
normal = [0, 0, 1]
offset = 30
material = "wall"
[[lights]]
position = [0, 0.3, 0]
intensity = [1, 1, 1]
"""
# Nodes add to radiance in another order
ROUNDING = {"single": 1e-6, "double": 1e-14}


def picture(scene, **options):
    return render(scene, resolution=(32, 32), boundary=False, **options).numpy()


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("name", ["chain", "nested"])
def test_any_levels_give_the_same_picture(name, precision):
    scene = parse_scene(CHAIN, precision) if name == "chain" else load_scene(name, precision)
    loop = picture(scene, unroll=0)
    assert np.ptp(loop) > 0.3
    # The first node is the same code in front of the loop, in the same order
    np.testing.assert_array_equal(picture(scene, unroll=1), loop)
    for levels in (2, 3):
        error = abs(picture(scene, unroll=levels) - loop).max()
        assert error <= ROUNDING[precision]


def test_levels_by_default():
    cloud = '[[clouds]]\nname = "c"\nspheres = [[0, 2, 0, 0.5]]\nmaterial = "mirror"\n'
    scenes = load_scene("cornell"), parse_scene(CHAIN), parse_scene(CHAIN + cloud)
    for scene, levels in zip(scenes, (1, 3, 0), strict=True):
        for depth in (1, 8):
            limits = Job(scene, {}, (8, 8), depth, 1, None).limits
            assert limits.levels == min(levels, depth)
            assert limits.loops == (depth > levels)


@pytest.mark.parametrize("depth", [1, 2, 4])
@pytest.mark.parametrize("name", ["chain", "cornell"])
def test_without_a_loop(name, depth):
    scene = parse_scene(CHAIN) if name == "chain" else load_scene(name)
    loop, straight = (picture(scene, max_depth=depth, unroll=n) for n in (0, 5))
    np.testing.assert_allclose(straight, loop, rtol=0, atol=ROUNDING["single"])


def test_faint_rays_are_left_out_of_straight_code_too():
    scene = load_scene("cornell").replace({"min_importance": 0.15})
    loop, straight = (picture(scene, max_depth=4, unroll=n) for n in (0, 4))
    assert abs(loop - picture(load_scene("cornell"), max_depth=4)).max() > 0.01
    np.testing.assert_allclose(straight, loop, rtol=0, atol=ROUNDING["single"])


@pytest.mark.parametrize("levels", [1, 2, 4])
def test_edges_are_the_same_with_any_levels(levels):
    """They compare labels of this kernel with those of others, which have loops."""
    scene, options = load_scene("cornell"), {"resolution": (32, 32), "max_depth": 4}
    loop, straight = (render(scene, unroll=n, **options).numpy() for n in (0, levels))
    np.testing.assert_allclose(straight, loop, rtol=0, atol=ROUNDING["single"])


def test_stack_has_room_for_the_nodes_below_straight_levels():
    """After six levels, 63 nodes wait, and from the last one the loop goes two levels deeper."""
    scene = load_scene("nested")
    for levels, capacity in ((0, 8), (1, 8), (2, 16), (6, 128)):
        limits = Job(scene, {}, (8, 8), 8, 1, None, unroll=levels).limits
        assert (limits.levels, limits.capacity, limits.loops) == (levels, capacity, True)
    assert not Job(scene, {}, (8, 8), 6, 1, None, unroll=6).limits.loops


@pytest.mark.parametrize("levels", [None, 0, 3, 11])
def test_stack_has_room_for_all_nodes_of_a_chain(levels):
    """Reverse mode keeps eleven nodes, however many levels are straight code."""
    scene = parse_scene(CORRIDOR, precision="double")
    options = {"boundary": False, "resolution": (8, 8)}
    values = scene.parameters("materials.m.reflection")
    dr.enable_grad(values)
    dr.backward(dr.sum(render(scene.replace(values), unroll=levels, **options), axis=None))
    (reverse,) = values["materials.m.reflection"].grad
    forward = gradient(scene, "materials.m.reflection", **options).numpy().sum()
    assert reverse == pytest.approx(forward, rel=1e-12)


@pytest.mark.parametrize(("wrong", "most"), [(-1, 6), (7, 6), (2.0, 6), (True, 6), (65, 64)])
def test_bad_levels_are_refused(wrong, most):
    scene = load_scene("cornell") if most == 6 else parse_scene(CHAIN)
    rays = "branch" if most == 6 else "form chains"
    expected = f"unroll: expected a whole number from 0 to {most}, since the scene's rays {rays}, "
    with pytest.raises(ValueError, match=expected + f"got {wrong}$"):
        render(scene, unroll=wrong)
