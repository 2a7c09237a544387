"""Random legal scenes: what holds for every scene holds for them.

300 scenes; `WHITTED_RANDOM_SCENES=10000 pytest tests/test_random_scenes.py` takes more. A failure
names the seed.
"""

import os

import numpy as np
import pytest
from gradcheck import as_type, directions, jvp, vjp
from random_scenes import (
    SHAPES,
    UP,
    jiggled,
    random_numbers,
    random_rotation,
    random_similarity,
    scene_of,
    with_up,
)
from samples import sphere

import whitted as wt

COUNT = int(os.environ.get("WHITTED_RANDOM_SCENES", "300"))
SEEDS = range(-(-COUNT // len(SHAPES)))  # each shape's part of all scenes
DEPTH = 4
BESIDE = 0.01  # of a radius: on a surface, a rounding decides what a whole image shows


@pytest.fixture(params=SHAPES)
def shape(request):
    return SHAPES[request.param]


@pytest.fixture
def compiled(load):
    """A function that loads a scene file, with all parameters taken for other than 0."""

    def load_all(text, precision="double"):
        scene = load(text, precision)
        return scene.replace(scene.parameters())

    return load_all


def plain(scene, depth=DEPTH):
    return wt.render(scene, boundary=False, max_depth=depth).numpy()


def edged(scene):
    return wt.render(scene, max_depth=DEPTH).numpy()


def tolerance(loaded, numbers, image, amount=1e-14, tries=3, render=plain):
    """What roundings of a relative size can change: little, but beside edges and where curved
    mirrors magnify them.
    """
    spread = [
        abs(render(scene_of(loaded, jiggled(numbers, seed, amount))) - image)
        for seed in range(tries)
    ]
    return 1e4 * amount * (1 + abs(image)) + 30 * np.max(spread, axis=0)


def check_derivatives(loaded, numbers, seed, agree=True, **options):
    """Image and derivatives are finite, and forward mode agrees with reverse mode."""
    values = scene_of(loaded, numbers).parameters()
    tangents = directions(values, seed)

    def image(values):
        return wt.render(loaded.replace(values), max_depth=DEPTH, **options)

    assert np.isfinite(image(values).numpy()).all(), seed
    forward = jvp(image, values, tangents)
    assert np.isfinite(forward).all(), seed
    weights = np.random.default_rng(seed).uniform(-1, 1, forward.shape)
    gradients = vjp(image, values, weights)
    assert not [name for name, value in gradients.items() if not np.isfinite(value).all()], seed
    if not agree:
        return
    # Both sum the same products in another order
    back = {name: gradients[name] * np.ravel(tangents[name]) for name in values}
    size = np.sum(abs(weights * forward)) + sum(np.sum(abs(value)) for value in back.values())
    assert (
        abs(np.sum(weights * forward) - sum(np.sum(value) for value in back.values()))
        <= 1e-9 * size
    ), seed


def test_plain_derivatives_are_finite_and_agree(shape, compiled):
    loaded = compiled(shape.text)
    for seed in SEEDS:
        check_derivatives(loaded, random_numbers(shape, seed), seed, boundary=False)


@pytest.mark.parametrize("name", ["ball", "glass"])
def test_derivatives_at_edges_are_finite_and_agree(name, compiled):
    """Of a fifth of the scenes, as finding edges takes longer."""
    loaded = compiled(SHAPES[name].text)
    for seed in SEEDS[::10]:
        check_derivatives(loaded, random_numbers(SHAPES[name], seed, BESIDE), seed)
    # On a surface, roundings decide what the camera sees, and differently in kernels for either
    # mode
    for seed in SEEDS[5::10]:
        check_derivatives(loaded, random_numbers(SHAPES[name], seed), seed, agree=False)


def test_similarity_and_order_change_nothing(shape, compiled):
    loaded, rotation = compiled(shape.text), random_rotation(1)
    turned = with_up(loaded, rotation @ UP)
    for seed in SEEDS:
        numbers = random_numbers(shape, seed, BESIDE)
        image = plain(scene_of(loaded, numbers))
        moved = plain(scene_of(turned, random_similarity(seed, rotation)(shape, numbers)))
        assert (abs(moved - image) <= tolerance(loaded, numbers, image)).all(), seed


@pytest.mark.parametrize("name", ["ball", "glass"])
def test_similarity_and_order_change_nothing_at_edges(name, compiled):
    """Of a tenth of the scenes. A search along a segment with several edges may find another of
    them first.
    """
    shape = SHAPES[name]
    loaded, rotation = compiled(shape.text), random_rotation(1)
    turned, wrong, pixels = with_up(loaded, rotation @ UP), 0, 0
    for seed in SEEDS[::10]:
        numbers = random_numbers(shape, seed, BESIDE)
        image = edged(scene_of(loaded, numbers))
        moved = edged(scene_of(turned, random_similarity(seed, rotation)(shape, numbers)))
        off = abs(moved - image) > tolerance(loaded, numbers, image, render=edged)
        wrong, pixels = wrong + np.count_nonzero(off.any(-1)), pixels + off[..., 0].size
    assert wrong <= 0.005 * pixels


def test_lights_twice_as_bright_double_the_image(shape, compiled):
    loaded = compiled(shape.text)
    dark = {"background": np.zeros(3), "ambient": np.zeros(3)}
    for seed in SEEDS[::2]:
        numbers = random_numbers(shape, seed) | dark
        bright = {
            name: value * 2 if name.endswith("intensity") else value
            for name, value in numbers.items()
        }
        # Twice is exact in binary numbers
        np.testing.assert_array_equal(
            plain(scene_of(loaded, bright)), 2 * plain(scene_of(loaded, numbers)), str(seed)
        )


def brightest(shape, numbers):
    """The most that one node of a tree can add, channel by channel."""
    materials = [f"materials.m{i}" for i in range(shape.spheres + shape.planes)]
    light = np.zeros(3)
    for i in range(shape.lights):
        nearest = min(distances(shape, numbers, numbers[f"lights.light{i}.position"]), default=1)
        falls = shape.falloff(i) == "inverse-square"
        light += numbers[f"lights.light{i}.intensity"] / (max(nearest**2, 1e-300) if falls else 1)
    glow = [
        numbers[f"{m}.color"] * (numbers["ambient"] + light) + numbers[f"{m}.specular"] * light
        for m in materials
    ]
    return np.max([numbers["background"], *glow], axis=0)


def distances(shape, numbers, p):
    """How far a point is from each surface."""
    for i in range(shape.spheres):
        yield abs(
            np.linalg.norm(p - numbers[f"spheres.sphere{i}.center"])
            - numbers[f"spheres.sphere{i}.radius"]
        )
    for i in range(shape.planes):
        yield abs(numbers[f"planes.plane{i}.normal"] @ p + numbers[f"planes.plane{i}.offset"])


def halved(numbers):
    """With such weights a node's children together weigh no more than the node."""
    return {
        name: value / 2 if name.endswith(("reflection", "refraction")) else value
        for name, value in numbers.items()
    }


def test_another_bounce_adds_no_more_than_its_weight_allows(shape, compiled):
    loaded, largest = compiled(shape.text), 0
    for seed in SEEDS[::2]:
        numbers = halved(random_numbers(shape, seed))
        scene = scene_of(loaded, numbers)
        weights = [
            numbers[name] + numbers[name.replace("flec", "frac")]
            for name in numbers
            if name.endswith("reflection")
        ]
        change = abs(plain(scene, DEPTH + 1) - plain(scene))
        largest = max(largest, change.max())
        assert (
            change
            <= max(weights, default=0) ** DEPTH * brightest(shape, numbers) * (1 + 1e-9) + 1e-12
        ).all(), seed
    # Something reflects and something is seen in it, unless nothing but a floor is there
    assert (largest > 0) == (shape.spheres > 0), largest


CLEAR = "[materials.clear]\nrefraction = 1\nior = 1\n" + sphere([0, 0, 0], 1, "clear")


def with_clear(compiled, shape):
    """The shape with one more sphere, which is clear."""
    loaded = compiled(f"{shape.text}\n{CLEAR}")
    clear = loaded.parameters(
        f"spheres.sphere{shape.spheres}.center", f"spheres.sphere{shape.spheres}.radius"
    )

    def scene(numbers, center, radius):
        ball = {
            name: as_type(old, value)
            for (name, old), value in zip(clear.items(), (center, radius), strict=True)
        }
        return scene_of(loaded, numbers).replace(ball)

    return scene


def test_clear_sphere_among_matte_things_changes_nothing(shape, compiled):
    """Where there is no light that it could keep out, as glass throws a full shadow."""
    loaded, scene = compiled(shape.text), with_clear(compiled, shape)
    black = ("reflection", "refraction", "intensity")
    for seed in SEEDS[::2]:
        numbers = {
            name: value * (not name.endswith(black))
            for name, value in random_numbers(shape, seed, BESIDE).items()
        }
        rng = np.random.default_rng(seed)
        extent = np.linalg.norm(numbers["camera.look_at"] - numbers["camera.position"])
        image = plain(scene_of(loaded, numbers))
        more = plain(scene(numbers, rng.normal(size=3) * extent, rng.uniform(0.1, 2) * extent))
        assert (abs(more - image) <= tolerance(loaded, numbers, image)).all(), seed


@pytest.mark.parametrize("name", ["ball", "crowd"])
def test_clear_sphere_around_everything_changes_nothing(name, compiled):
    """Where nothing comes from outside: a ray that leaves is one node longer."""
    shape = SHAPES[name]
    loaded, scene = compiled(shape.text), with_clear(compiled, shape)
    for seed in SEEDS[::2]:
        numbers = random_numbers(shape, seed, BESIDE) | {"background": np.zeros(3)}
        image = plain(scene_of(loaded, numbers))
        assert (
            abs(plain(scene(numbers, [0, 0, 0], 1e5)) - image) <= tolerance(loaded, numbers, image)
        ).all(), seed


@pytest.mark.parametrize("name", ["ball", "glass"])
def test_single_precision_agrees_with_double(name, compiled):
    shape = SHAPES[name]
    double, single = (compiled(shape.text, precision) for precision in ("double", "single"))
    for seed in SEEDS:
        numbers = random_numbers(shape, seed, BESIDE)
        image = plain(scene_of(double, numbers))
        error = abs(plain(scene_of(single, numbers)) - image)
        assert (error <= tolerance(double, numbers, image, 3e-7, 8)).all(), seed
