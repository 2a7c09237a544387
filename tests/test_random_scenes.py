"""Random legal scenes: what holds for every scene holds for them.

300 scenes; `WHITTED_RANDOM_SCENES=10000 pytest tests/test_random_scenes.py` takes more. A failure names the shape and
the seed; those that were found on the way are in `FOUND`.
"""

import os

import drjit as dr
import numpy as np
import pytest
from gradcheck import adjoint_error, directions
from random_scenes import SHAPES, UP, jiggled, random_numbers, random_rotation, random_similarity, scene_of, with_up

import whitted as wt

COUNT = int(os.environ.get("WHITTED_RANDOM_SCENES", "300"))
DEPTH = 4


def seeds(shape):
    """Each shape's part of all scenes."""
    return range(-(-COUNT // len(SHAPES)))


def plain(scene, depth=DEPTH):
    return wt.render(scene, boundary=False, max_depth=depth).numpy()


@pytest.fixture(params=SHAPES)
def shape(request):
    return SHAPES[request.param]


@pytest.fixture
def loaded(load, shape):
    """A scene of the shape, all of whose parameters may be other than 0."""
    scene = load(shape.text)
    return scene.replace(scene.parameters())


def assert_finite(gradients, where):
    bad = [name for name, value in gradients.items() if not np.isfinite(value).all()]
    assert not bad, (where, bad)


def gradient_of(scene, **options):
    """The image, and derivatives of a weighted sum of its numbers by all parameters."""
    params = scene.parameters()
    dr.enable_grad(params)
    image = wt.render(scene.replace(params), max_depth=DEPTH, **options)
    weights = np.random.default_rng(0).uniform(-1, 1, image.shape)
    dr.backward(dr.sum((image * type(image)(weights)).array))
    return image.numpy(), {name: dr.grad(value).numpy() for name, value in params.items()}


def test_plain_image_and_gradients_are_finite(shape, loaded):
    for seed in seeds(shape):
        image, gradients = gradient_of(scene_of(loaded, random_numbers(shape, seed)), boundary=False)
        assert_finite({"image": image, **gradients}, seed)


def test_forward_agrees_with_reverse(shape, loaded):
    for seed in seeds(shape):
        values = scene_of(loaded, random_numbers(shape, seed)).parameters()

        def function(values):
            return wt.render(loaded.replace(values), boundary=False, max_depth=DEPTH)

        # Both sum the same products in another order
        assert adjoint_error(function, values, directions(values, seed), seed) < 1e-9, seed


def test_similarity_and_order_change_nothing(shape, loaded):
    rotation = random_rotation(1)
    turned = with_up(loaded, rotation @ UP)
    for seed in seeds(shape):
        numbers = random_numbers(shape, seed)
        image = plain(scene_of(loaded, numbers))
        moved = plain(scene_of(turned, random_similarity(seed, rotation)(shape, numbers)))
        error = abs(moved - image) / tolerance(loaded, numbers, image)
        assert error.max() <= 1, (seed, error.max(), np.argwhere(error > 1))


def tolerance(loaded, numbers, image, amount=1e-14):
    """What roundings of a relative size can change: little, but beside edges and where curved mirrors magnify them."""
    spread = [abs(plain(scene_of(loaded, jiggled(numbers, seed, amount))) - image) for seed in range(3)]
    return 1e-10 * (1 + abs(image)) + 30 * np.max(spread, axis=0)
