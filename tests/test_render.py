"""The image as one operation: its arguments, bands, kernels and derivatives as a whole."""

import subprocess
import sys

import drjit as dr
import numpy as np
import pytest
from gradcheck import SUM, like
from reference import ERROR, Reference
from samples import (
    CAMERA,
    CHECKER,
    EPSILON,
    FLOOR,
    LIGHT,
    ROOM,
    SCENES,
    SECOND_LIGHT,
    SKY,
    scene,
    sphere,
    three,
    toml,
)
from samples import render_plain as render

from whitted.measure.about import compiled_in, features
from whitted.measure.timing import recorded
from whitted.rendering import job


def tangent(scene, name="spheres.sphere0.radius", **options):
    """The image's derivative by one parameter, forward."""
    params = scene.parameters(name)
    dr.enable_grad(params)
    dr.set_grad(params, {name: dr.ones(type(params[name]))})
    return dr.forward_to(
        render(scene.replace(params), **options), flags=dr.ADFlag.ClearNone
    ).numpy()


def gradients(scene, **options):
    """The derivatives of a loss that weighs every number of the image differently, by name."""
    params = scene.parameters()
    dr.enable_grad(params)
    image = render(scene.replace(params), **options)
    weights = np.random.default_rng(1).uniform(-1, 1, image.shape)
    dr.backward(dr.sum((image * like(image, weights)).array))
    return {name: np.array(dr.grad(value)).ravel() for name, value in params.items()}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        *(
            (
                {"terms": terms},
                rf"^terms: expected one of both, interior, boundary, with boundary=True, "
                rf"got {terms!r}$",
            )
            for terms in ("interior", "boundary", "edges", None)
        ),
        *(
            (
                {"spp": spp},
                rf"^spp: expected a perfect square \(1, 4, 9, 16, ...\) up to 65536, got {spp!r}$",
            )
            for spp in (0, -4, 2, 8, 4.0, True, None, "4", (1 << 16) + 1, 257**2)
        ),
        *(
            (
                {"max_depth": depth},
                rf"^max_depth: expected a whole number from 1 to 256, got {depth!r}$",
            )
            for depth in (0, -1, 257, 2.0, True, "3")
        ),
        *(
            (
                {"resolution": size},
                r"^resolution: expected \(width, height\), two whole numbers of pixels > 0, got ",
            )
            for size in (
                (8, 0),
                (8,),
                (8, 8, 8),
                8,
                "88",
                (8.0, 8),
                (-8, 8),
                (True, 8),
                ((1 << 20) + 1, 1),
            )
        ),
        (
            {"resolution": (1 << 20, 1 << 20)},
            r"^resolution: an image of 1048576 x 1048576 takes 24576\.0 GiB, too much; "
            r"use a smaller one$",
        ),
    ],
)
def test_argument_out_of_range_is_refused(load, options, message):
    with pytest.raises(ValueError, match=message):
        render(load(SCENES["all"]), **options)


@pytest.mark.parametrize(
    "options", [{"spp": np.int64(4)}, {"max_depth": np.int32(2)}, {"resolution": [np.int64(5), 3]}]
)
def test_whole_numbers_of_numpy_are_welcome(load, options):
    scene = load(SCENES["all"])
    plain = {
        key: [int(n) for n in value] if key == "resolution" else int(value)
        for key, value in options.items()
    }
    np.testing.assert_array_equal(render(scene, **options).numpy(), render(scene, **plain).numpy())


def test_image_is_a_tensor_of_height_width_3(load, precision):
    image = render(load(SCENES["all"], precision))
    assert (type(image).__name__, image.shape) == (
        {"single": "TensorXf", "double": "TensorXf64"}[precision],
        (12, 16, 3),
    )


@pytest.mark.parametrize("side", [2, 3])
def test_samples_are_the_pixels_of_a_finer_image(load, side):
    """Sample (i, j) of n * n sits where the finer image of n times the width and height has a
    pixel's center.
    """
    scene = load(SCENES["diffuse under two lights"])
    fine = render(scene, resolution=(16 * side, 12 * side)).numpy()
    blocks = fine.reshape(12, side, 16, side, 3).mean((1, 3))
    # Positions agree to a rounding, so that radiance agrees to a few hundred; no edge is that near
    # to a sample
    np.testing.assert_allclose(render(scene, spp=side * side).numpy(), blocks, rtol=0, atol=1e-13)


def test_resolution_overrides_the_scenes(load):
    text = SCENES["all"]
    expected = Reference(text.replace("[16, 12]", "[7, 9]")).image()
    np.testing.assert_allclose(
        render(load(text), resolution=(7, 9)).numpy(), expected, rtol=0, atol=ERROR
    )


def test_max_depth_overrides_the_scenes(load):
    text = SCENES["all"]
    shallow, deep = (Reference(f"max_depth = {depth}\n" + text).image() for depth in (2, 6))
    scene = load("max_depth = 6\n" + text)
    np.testing.assert_allclose(render(scene, max_depth=2).numpy(), shallow, rtol=0, atol=ERROR)
    np.testing.assert_allclose(render(scene).numpy(), deep, rtol=0, atol=ERROR)
    # The two depths are told apart
    assert abs(shallow - deep).max() > 0.01


@pytest.mark.parametrize("spp", [1, 4])
@pytest.mark.parametrize("rows", [4, 8])
def test_image_in_bands_is_the_image_in_one(load, monkeypatch, precision, spp, rows):
    """An image in several bands is the image in one, to the last bit; sums over its pixels are
    taken in another order.
    """
    scene = load(SCENES["all"], precision)
    size = (10, 18)  # 18 rows: the last band is not full
    whole = render(scene, spp, resolution=size).numpy()
    whole_tangent, whole_gradients = (
        tangent(scene, spp=spp, resolution=size),
        gradients(scene, spp=spp, resolution=size),
    )
    monkeypatch.setattr(job, "BAND", 10 * spp * rows)
    done = []
    banded = render(scene, spp, resolution=size, progress=done.append).numpy()
    np.testing.assert_allclose(
        done, [(k + rows) / 18 if k + rows < 18 else 1 for k in range(0, 18, rows)]
    )
    np.testing.assert_array_equal(banded, whole)
    np.testing.assert_array_equal(tangent(scene, spp=spp, resolution=size), whole_tangent)
    # Sums of up to 2160 terms of both signs. Roundings of random sign add up to 46 of the largest
    # partial sum, which is a few times the whole
    tolerance = 200 * EPSILON[precision]
    for name, value in gradients(scene, spp=spp, resolution=size).items():
        np.testing.assert_allclose(
            value, whole_gradients[name], rtol=tolerance, atol=tolerance, err_msg=name
        )


def test_progress_is_reported_once_for_one_band(load):
    done = []
    render(load(SCENES["all"]), progress=done.append)
    assert done == [1]


def test_error_in_progress_stops_the_render(load):
    def stop(fraction):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(load(SCENES["all"]), progress=stop)


def test_image_is_the_same_twice(load, precision):
    scene = load(SCENES["all"], precision)
    np.testing.assert_array_equal(render(scene, 4).numpy(), render(scene, 4).numpy())


def test_image_is_detached_unless_asked(load):
    scene = load(SCENES["all"])
    assert not dr.grad_enabled(render(scene))
    params = scene.parameters("background")
    dr.enable_grad(params)
    assert dr.grad_enabled(render(scene.replace(params)))


BALL = [[0, 0, 0], 0.9]
GROWING = {
    "no light": scene(sphere(*BALL, "red"), FLOOR.replace("checks", "red")),
    "one light": scene(sphere(*BALL, "red"), FLOOR.replace("checks", "red"), LIGHT),
    "two lights": scene(sphere(*BALL, "red"), FLOOR.replace("checks", "red"), LIGHT, SECOND_LIGHT),
    "mirror": scene(sphere(*BALL, "mirror"), FLOOR.replace("checks", "red"), LIGHT, SECOND_LIGHT),
    "constant glass": scene(
        sphere(*BALL, "tinted"), FLOOR.replace("checks", "mirror"), LIGHT, SECOND_LIGHT
    ),
    "Fresnel glass": scene(
        sphere(*BALL, "glass"), FLOOR.replace("checks", "mirror"), LIGHT, SECOND_LIGHT
    ),
    "nested glass": scene(
        sphere(*BALL, "glass"),
        sphere(BALL[0], 0.5, "air"),
        FLOOR.replace("checks", "mirror"),
        LIGHT,
        SECOND_LIGHT,
    ),
}


def test_scene_with_less_gets_a_smaller_kernel(load):
    """In a loop. Chains have more levels of straight code than trees."""
    sizes = []
    for text in GROWING.values():
        loaded = load(text, "single")
        with recorded() as kernels:
            dr.eval(render(loaded, unroll=0))
        sizes.append(kernels.operations)
    assert sizes == sorted(set(sizes)), dict(zip(GROWING, sizes, strict=True))


def test_black_terms_are_not_compiled(load):
    def size(text):
        loaded = load(text, "single")
        with recorded() as kernels:
            dr.eval(render(loaded))
        return kernels.operations

    whole = size(scene(three("red", "red", "red"), LIGHT))
    assert size(scene(three("red", "red", "red"), LIGHT, sky="")) < whole
    assert size(scene(three("red", "red", "red"), LIGHT).replace("specular = 0.4", "")) < whole
    assert (
        size(scene(three("red", "red", "red"), LIGHT).replace("color = [0.8, 0.2, 0.1]", ""))
        < whole
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (SKY + CAMERA, ["ambient"]),
        (
            GROWING["one light"],
            [
                "1 sphere",
                "1 plane",
                "1 light with hard shadows",
                "Lambert",
                "Blinn-Phong",
                "ambient",
            ],
        ),
        (
            scene(three("red", "red", "mirror"), FLOOR, LIGHT, SECOND_LIGHT, sky=""),
            [
                "3 spheres",
                "1 plane",
                "2 lights with hard shadows",
                "inverse-square falloff",
                "Lambert",
                "checkerboard",
            ]
            + ["Blinn-Phong", "reflection", "chain of rays"],
        ),
        (
            scene(sphere(*BALL, "water"), sky=""),
            ["1 sphere", "reflection", "refraction", "chain of rays"],
        ),
        (
            scene(sphere(*BALL, "glass"), sphere(*BALL, "air"), sky="min_importance = 0.1\n"),
            [
                "2 spheres",
                "Lambert",
                "Blinn-Phong",
                "reflection",
                "refraction",
                "Fresnel",
                "least importance",
            ]
            + ["coinciding primitives", "tree of rays"],
        ),
        (CAMERA, []),
        (
            scene(sphere([0, -1e6, 0], 1e6, "red"), sky=""),
            ["1 sphere", "Lambert", "Blinn-Phong", "compensated sums"],
        ),
    ],
)
def test_features_are_named(load, text, expected):
    assert features(load(text, "single")) == expected
    assert compiled_in(load(text, "single")) == (", ".join(expected) or "nothing")


def opaque_copy(value, scale):
    """The value times a number, which is no part of a kernel's code."""
    numbers = [
        dr.opaque(dr.value_t(value) if dr.depth_v(value) == 2 else type(value), float(x))
        for x in value.numpy().ravel() * scale
    ]
    return type(value)(*numbers)


def step(loaded, scale, **options):
    """A step of an optimisation: image and derivatives by all parameters."""
    params = {name: opaque_copy(value, scale) for name, value in loaded.parameters().items()}
    dr.enable_grad(params)
    image = render(loaded.replace(params), **options)
    # A plain sum's adjoint is a literal, which gets a kernel of its own
    dr.backward(dr.sum(dr.square(image.array)))
    dr.eval(image, dr.grad(params))


def kernels_not_in_memory(loaded, scale, **options):
    """For a step of an optimisation: the operations of each kernel that was compiled or read from
    disk, and those of the largest kernel of all.
    """
    dr.sync_thread()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        step(loaded, scale, **options)
        dr.sync_thread()
        kernels = [kernel for kernel in dr.kernel_history() if "cache_hit" in kernel]
    new = [
        kernel["operation_count"]
        for kernel in kernels
        if not kernel["cache_hit"] or kernel["cache_disk"]
    ]
    return new, max(kernel["operation_count"] for kernel in kernels)


def test_later_steps_compile_nothing(load):
    """Kernels do not depend on the values of the parameters."""
    loaded = load(SCENES["bubble in glass, ball in water"], "single")
    step(loaded, 1)
    with recorded() as kernels:
        step(loaded, 1.01)
    assert kernels.compiled == 0
    new, largest = kernels_not_in_memory(loaded, 0.99)
    assert not new
    # The renderer's own kernels were among them
    assert largest > 1000


def test_other_sizes_compile_nothing(load):
    """Kernels do not depend on the size of the image, the number of samples (but for one sample a
    pixel, which needs no loop), or the number of rows in the last band.
    """
    loaded = load(SCENES["bubble in glass, ball in water"], "single")
    step(loaded, 1)
    step(loaded, 1, spp=4)
    for options in (
        {"resolution": (21, 34)},
        {"spp": 9},
        {"max_depth": loaded.max_depth, "resolution": (4, 4)},
    ):
        assert kernels_not_in_memory(loaded, 1.01, **options)[0] == [], options


def checks_and_veils(size, veil):
    """A scene with numbers of its own for its checkerboard, and for how much a thing shadows."""
    text = scene(three("red", "veil", "bright_glass"), ROOM)
    text = text.replace(toml(CHECKER), toml({"color": [size, 0, 1], "size": size}))
    return text.replace("shadow = 0.35", f"shadow = {veil}")


def test_other_checkers_and_shadow_weights_compile_nothing(load):
    """Scenes that differ only in these numbers share their kernels, those for derivatives too."""
    assert checks_and_veils(0.37, 0.35) != checks_and_veils(0.61, 0.35)
    assert checks_and_veils(0.61, 0.35) != checks_and_veils(0.61, 0.8)
    step(load(checks_and_veils(0.37, 0.35), "single"), 1)
    new, largest = kernels_not_in_memory(load(checks_and_veils(0.61, 0.8), "single"), 1)
    assert not new
    assert largest > 1000


@pytest.mark.slow
def test_depths_in_any_order_have_their_images_and_derivatives(load):
    """A kernel never runs with the stack of another depth, in any of the three modes.

    Dr.Jit takes two kernels for one that differ in nothing but the size of a stack.
    """
    text = SCENES["overlapping glass"].replace("[16, 12]", "[8, 6]")
    loaded = load(text)
    seen = {}
    for depth in (1, 5, 8, 14, 3):
        expected = Reference(f"max_depth = {depth}\n" + text).image()
        np.testing.assert_allclose(
            render(loaded, max_depth=depth).numpy(), expected, rtol=0, atol=ERROR
        )
        slope, gradient = (
            tangent(loaded, "camera.fov", max_depth=depth),
            gradients(loaded, max_depth=depth),
        )
        assert np.isfinite(slope).all()
        assert all(np.isfinite(value).all() for value in gradient.values())
        weights = np.random.default_rng(1).uniform(-1, 1, slope.shape)
        # Both sum the same products in another order
        size = np.sum(abs(weights * slope))
        np.testing.assert_allclose(
            gradient["camera.fov"], np.sum(weights * slope), rtol=0, atol=SUM * size
        )
        seen[depth] = gradient["background"]
    # Deeper trees add ever less, but always something
    change = [np.abs(seen[b] - seen[a]).max() for a, b in ((1, 3), (3, 5), (5, 8), (8, 14))]
    assert change[0] > change[-1] > 0


def test_depth_changes_nothing_where_nothing_reflects(load):
    loaded = load(scene(three("red", "red", "red"), ROOM))
    np.testing.assert_array_equal(
        render(loaded, max_depth=1).numpy(), render(loaded, max_depth=9).numpy()
    )


THREADS = """
import sys, threading
import numpy as np
import whitted as wt

# Python passes on from thread to thread wherever it may
sys.setswitchinterval(1e-6)
scene = wt.load_scene(sys.argv[1])
found = [[] for _ in range(4)]
def work(images):
    images.extend(wt.render(scene).numpy() for _ in range(50))
threads = [threading.Thread(target=work, args=[images]) for images in found]
for thread in threads: thread.start()
for thread in threads: thread.join()
assert all(len(images) == 50 for images in found)
for images in found:
    for image in images: np.testing.assert_array_equal(image, found[0][0])
"""


@pytest.mark.slow
def test_threads_get_the_same_images(tmp_path):
    """In a process of its own, as threads that wait for each other would hang this one."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENES["all"])
    done = subprocess.run(
        [sys.executable, "-c", THREADS, str(path)], timeout=120, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
