"""What is kept of kernels: one recording for each structure of scenes, and no more than a bound.

Numbers and names are no part of a structure.
"""

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad

import whitted as wt
from whitted.core import frozen as module
from whitted.core.frozen import frozen

SCENE = """
background = [{a}, 0.1, 0.2]
ambient = [0.1, {a}, 0.1]
max_depth = {depth}
min_importance = {a}e-3

[camera]
position = [{a}, 0, 4]
look_at = [0, {a}, 0]
up = [{a}, 1, 0]
fov = 5{n}
resolution = [14, 9]

[materials.{x}]
color = [{a}, 0.5, 0.5]
specular = {a}
shininess = 3{n}
checker = {{ color = [1, {a}, 1], size = {a} }}

[materials.{y}]
reflection = {a}
refraction = {a}
ior = 1.{n}
shadow = {a}
fresnel = true

[materials.{z}]
color = [{a}, 0, 0]

[[spheres]]
name = "{x}"
center = [0, {a}, 0]
radius = 0.{n}
material = "{y}"

[[spheres]]
name = "{z}"
center = [1, 0, {a}]
radius = {a}
material = "{z}"

[[planes]]
name = "{y}"
normal = [0, 1, {a}]
offset = 1.{n}
material = "{x}"

[[lights]]
name = "{x}"
position = [1, 3, {n}]
intensity = [1, {a}, 1]
falloff = "inverse-square"

[[lights]]
name = "{z}"
type = "directional"
direction = [{a}, -1, 0]
irradiance = [{a}, 0, 0]
"""


def scene(a, n, depth, names):
    return wt.parse_scene(
        SCENE.format(a=a, n=n, depth=depth, **dict(zip("xyz", names, strict=True)))
    )


def derivatives(scene, spp=1):
    """An image with edges, one without, and derivatives of both by all parameters."""
    for boundary in (True, False):
        values = scene.parameters()
        dr.enable_grad(values)
        image = wt.render(scene.replace(values), spp, boundary=boundary)
        dr.backward(dr.sum(dr.square(image.array)))
        dr.eval(dr.grad(values))
    dr.sync_thread()


def new_kernels(call):
    """The operations of each kernel that was compiled, or read from disk, in a call."""
    dr.sync_thread()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        call()
        dr.sync_thread()
        kernels = [kernel for kernel in dr.kernel_history() if "cache_hit" in kernel]
    return [
        kernel["operation_count"]
        for kernel in kernels
        if not kernel["cache_hit"] or kernel["cache_disk"]
    ]


def test_numbers_and_names_are_no_part_of_kernels():
    """Also those that no derivative is taken by. Other sizes are another recording."""
    first = scene(0.31, 4, 3, "abc")
    derivatives(first)
    # With pixels where edges crowd, which have kernels of their own
    derivatives(first.replace({"camera.resolution": (40, 30)}), 4)
    made = module._store.made
    other = scene(0.27, 6, 5, ("walls", "a", "glass_of_water"))
    derivatives(other)
    assert module._store.made == made
    larger = other.replace({"camera.resolution": (24, 14)})
    assert new_kernels(lambda: derivatives(larger, 4)) == []


def test_derivatives_have_the_names_of_their_parameters():
    found = []
    for names in ("abc", "bca"):
        named = scene(0.31, 4, 3, names)
        values = named.parameters()
        dr.enable_grad(values)
        dr.backward(dr.sum(dr.square(wt.render(named.replace(values), boundary=False).array)))
        found.append([dr.grad(value).numpy() for value in values.values()])
    for one, other in zip(*found, strict=True):
        # Sums of lanes have no fixed order
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-5)


@pytest.fixture
def powers(monkeypatch):
    """A frozen function with a recording for each exponent, the exponents that it was recorded
    for, and a list of others' frozen functions, which stay.
    """
    module._store.drop(0)
    monkeypatch.setattr(module, "KEPT", 2)
    monkeypatch.setattr(module._store, "made", 0)
    recorded = []

    @frozen
    def power(x, exponent):
        recorded.append(exponent)
        return x**exponent

    def call(exponent):
        assert power(dr.opaque(ad.Float, 2), exponent).numpy() == [2**exponent]

    yield call, recorded
    module._store.by_function.pop()


def test_the_recording_not_used_for_longest_is_dropped(powers):
    call, recorded = powers
    for exponent in (3, 4, 3, 5, 3, 4, 5):
        call(exponent)
    assert recorded == [3, 4, 5, 4, 5]
    assert sum(map(len, module._store.by_function)) == 2


def test_kernels_are_freed(powers, monkeypatch):
    """All of them, with all recordings; what is used later is right."""
    call, recorded = powers
    monkeypatch.setattr(module, "MADE", 2)
    for other in module._store.others:
        other.clear()
    kernel = ad.Float(2) ** 7 + dr.opaque(ad.Float, 0.375)
    dr.eval(kernel)
    for exponent in (3, 4, 5, 4, 5):
        call(exponent)
    # 4 went with 3, though it would have been kept
    assert recorded == [3, 4, 5, 4]
    again = ad.Float(2) ** 7 + dr.opaque(ad.Float, 0.375)
    assert new_kernels(lambda: dr.eval(again))


def test_kernels_stay_where_others_have_recordings(powers, monkeypatch):
    """Dr.Jit would crash in a replay whose kernel was freed and compiled again."""
    call, _ = powers
    monkeypatch.setattr(module, "MADE", 1)
    others = dr.freeze(lambda x: x * 3 + 0.125)
    x = dr.opaque(ad.Float, 2, 64)
    expected = others(x).numpy()
    for exponent in (3, 4, 5, 6):
        call(exponent)
    assert new_kernels(lambda: np.testing.assert_array_equal(others(x).numpy(), expected)) == []


def test_recordings_go_where_the_user_frees_kernels(powers):
    call, recorded = powers
    call(3)
    dr.flush_kernel_cache()
    # The same kernel, at another address
    x = dr.opaque(ad.Float, 2)
    assert (x**3).numpy() == [8]
    call(3)
    assert recorded == [3, 3]


def test_nothing_is_dropped_while_another_function_is_recorded(powers, monkeypatch):
    call, recorded = powers
    call(3)
    call(4)
    monkeypatch.setattr(module, "MADE", 1)

    @dr.freeze
    def outer(x):
        module._store.make_room()
        return x * 2

    outer(dr.opaque(ad.Float, 2))
    call(3)
    assert recorded == [3, 4]
