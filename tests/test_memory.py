"""Arrays stand in Dr.Jit's own memory, wherever their numbers came from.

One that NumPy owns has another alignment, for which kernels are recorded anew. And if such an array
is freed while kernels are recorded, as by the garbage collector, Dr.Jit ends the process.
"""

import copy
import multiprocessing
import pickle
import subprocess
import sys

import drjit as dr
import numpy as np
import pytest
from samples import camera, light, material, plane, sphere

import whitted as wt

CENTER, RADIUS, OFFSET = "spheres.ball.center", "spheres.ball.radius", "planes.floor.offset"


TEXT = (
    camera((0, 0, 3), resolution=(12, 8))
    + material("red", color=(0.8, 0.2, 0.1))
    + sphere((0, 0, 0), 0.5, "red", "ball")
    + plane((0, 1, 0), 1, "red", "floor")
    + light((1, 3, 2))
)


@pytest.fixture
def loaded(load):
    return load(TEXT, "single")


def step(scene):
    """An image with edges, and its derivatives by all parameters."""
    values = scene.parameters()
    dr.enable_grad(values)
    image = wt.render(scene.replace(values))
    dr.set_grad(image, image * 2)
    dr.enqueue(dr.ADMode.Backward, image)
    dr.traverse(dr.ADMode.Backward)
    return image.numpy(), {name: dr.grad(value).numpy() for name, value in values.items()}


def not_in_memory(call):
    """The operations of each kernel that was compiled, or read from disk, in a call."""
    dr.sync_thread()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        call()
        dr.sync_thread()
        kernels = [kernel for kernel in dr.kernel_history() if "cache_hit" in kernel]
    assert kernels
    return [
        kernel["operation_count"]
        for kernel in kernels
        if not kernel["cache_hit"] or kernel["cache_disk"]
    ]


def in_numpys_memory(scene, name):
    """A parameter's value in NumPy's memory, 4 or 8 bytes behind a multiple of 64."""
    old = scene.parameters(name)[name]

    def moved(part):
        buffer = np.empty(32, scene.precision.dtype)
        first = -buffer.ctypes.data % 64 // buffer.itemsize + 1
        buffer[first] = part[0]
        return scene.precision.real(buffer[first : first + 1])

    return type(old)(*map(moved, old)) if dr.depth_v(old) == 2 else moved(old)


@pytest.mark.parametrize(
    "change",
    [
        lambda scene: pickle.loads(pickle.dumps(scene)),
        copy.copy,
        copy.deepcopy,
        lambda scene: scene.replace({CENTER: np.zeros(3), RADIUS: 0.5}),
        lambda scene: scene.replace({CENTER: (0.0, 0.0, 0.0), RADIUS: np.float32(0.5)}),
        lambda scene: scene.replace(
            {name: in_numpys_memory(scene, name) for name in scene.parameters()}
        ),
    ],
    ids=["pickle", "copy", "deepcopy", "numpy", "python", "drjit"],
)
def test_scenes_from_anywhere_use_the_same_kernels(loaded, change):
    if change not in (copy.copy, copy.deepcopy):
        # What is compiled in must not differ
        loaded = loaded.replace(loaded.parameters())
    expected = step(loaded)
    found = []
    assert not_in_memory(lambda: found.append(step(change(loaded)))) == []
    image, gradients = found[0]
    np.testing.assert_array_equal(image, expected[0])
    for name, gradient in gradients.items():
        # Sums of lanes have no fixed order
        np.testing.assert_allclose(gradient, expected[1][name], rtol=1e-4, atol=1e-5)


def test_a_tangent_in_numpys_memory_uses_the_same_kernels(loaded):
    def derivative(tangent):
        values = loaded.parameters(CENTER)
        dr.enable_grad(values)
        dr.set_grad(values[CENTER], tangent)
        return dr.forward_to(wt.render(loaded.replace(values))).numpy()

    zero = in_numpys_memory(loaded, CENTER)
    derivative(type(zero)(1))
    # At most the little kernel that copies
    assert sum(not_in_memory(lambda: derivative(zero))) < 20


def test_a_loss_does_not_keep_the_image(loaded):
    def big_arrays():
        dr.sync_thread()
        return sum(str(77 * 53 * 3) in line for line in dr.whos(as_string=True).splitlines())

    values = loaded.parameters(CENTER)
    dr.enable_grad(values)
    image = wt.render(loaded.replace(values), resolution=(77, 53), boundary=False)
    loss = dr.mean(image)
    dr.eval(loss, image)
    assert big_arrays() == 2
    del image
    # What is left is the image's place in the graph of derivatives
    assert big_arrays() == 1
    del loss
    assert big_arrays() == 0


def test_replaced_arrays_keep_their_gradients(loaded):
    given = in_numpys_memory(loaded, RADIUS)
    dr.enable_grad(given)
    scene = loaded.replace({RADIUS: given * 2, OFFSET: 3 * given})
    own = scene.parameters(RADIUS, OFFSET)
    dr.backward(own[RADIUS] + own[OFFSET])
    assert given.grad == 5
    np.testing.assert_allclose(own[RADIUS].numpy(), 1, rtol=1e-6)


def test_a_pickle_has_numbers_and_no_gradients(load, precision):
    loaded = load(TEXT, precision)
    values = loaded.parameters(RADIUS)
    dr.enable_grad(values)
    data = pickle.dumps(loaded.replace(values))
    assert b"numpy" not in data
    assert b"drjit" not in data
    arrived = pickle.loads(data)
    assert not dr.grad_enabled(arrived.parameters(RADIUS))
    assert arrived.numbers == loaded.numbers
    assert arrived.structure == loaded.replace(values).structure


def _rendered(scene):
    return wt.render(scene).numpy()


def test_a_scene_goes_to_other_processes(loaded):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        np.testing.assert_array_equal(pool.apply(_rendered, [loaded]), _rendered(loaded))


GARBAGE = """
import gc, pickle, sys
import drjit as dr
import numpy as np
import whitted as wt
from drjit.llvm import ad
from whitted.core.frozen import frozen

scene = wt.load_scene(sys.argv[1])
name = "spheres.ball.radius"
picture = np.ones((8, 12, 3), np.float32)
wt.write_image(sys.argv[2], picture)

def attached():
    value = ad.Float(np.array([0.5], np.float32))
    dr.enable_grad(value)
    return scene.replace({name: value})

def differentiated():
    given = scene.replace({name: ad.Float(np.array([0.5], np.float32))})
    values = given.parameters(name)
    dr.enable_grad(values)
    image = wt.render(given.replace(values))
    dr.set_grad(image, ad.TensorXf(picture))
    dr.enqueue(dr.ADMode.Backward, image)
    dr.traverse(dr.ADMode.Backward)
    return given, values, image, wt.gradient(given, name)

makers = {
    "pickled": lambda: pickle.loads(pickle.dumps(scene)),
    "numpy": lambda: scene.replace({name: np.array([0.5])}),
    "drjit": lambda: scene.replace({name: ad.Float(np.array([0.5], np.float32))}),
    "attached": attached,
    "read": lambda: wt.read_image(sys.argv[2]),
    "fit": lambda: wt.fit(
        scene, picture, wrt=[name], mask=picture[:, :, 0], iterations=2, budget=None
    ),
    "differentiated": differentiated,
}
for what, make in makers.items():
    cycle = [make()]
    cycle.append(cycle)

    @frozen
    def doubled(x):
        global cycle
        del cycle
        assert gc.collect()
        return x * 2

    print(what, flush=True)
    assert doubled(dr.opaque(ad.Float, 3)).numpy() == [6]
"""


def test_what_the_package_made_may_be_freed_while_kernels_are_recorded(load, tmp_path):
    """In a process of its own, which Dr.Jit would end."""
    load(TEXT, "single")
    command = [sys.executable, "-c", GARBAGE, str(tmp_path / "scene.toml"), tmp_path / "a.exr"]
    done = subprocess.run(command, timeout=120, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
