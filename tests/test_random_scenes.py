"""Random legal scenes: what holds for every scene holds for them.

300 scenes; `WHITTED_RANDOM_SCENES=10000 pytest tests/test_random_scenes.py` takes more. Hypothesis
draws them, the same ones in every run, and prints the simplest scene that fails.
"""

import numpy as np
import pytest
from gradcheck import as_type, directions, jvp, vjp
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scenes import LAYOUTS, UP, jiggled, length_scale, random_rotation, scene_of, with_up
from reference import Reference
from samples import EPSILON, material, sphere
from strategies import scenes, similarities

import whitted as wt

DEPTH = 4
ROTATION = random_rotation(1)


def one_of(count):
    """Runs a test for one of so many of each layout's scenes."""
    return settings(max_examples=-(-settings.default.max_examples // count))


@pytest.fixture(scope="module", params=LAYOUTS)
def layout(request):
    return LAYOUTS[request.param]


@pytest.fixture(scope="module")
def compiled(loaded):
    """A function that loads a scene file and compiles all parameters in, also those that are 0."""

    def load_all(text, precision="double"):
        scene = loaded(text, precision)
        return scene.replace(scene.parameters())

    return load_all


def plain(scene, depth=DEPTH):
    return wt.render(scene, boundary=False, max_depth=depth).numpy()


def edged(scene):
    return wt.render(scene, max_depth=DEPTH).numpy()


def tolerance(scene, numbers, image, precision="double", scale=None, render=plain):
    """How far a scene's image may be from another one that is the same but for roundings.

    Geometry is bounded by its backward error. A position at the end of a chain of rays is off by
    some 10 roundings of the largest coordinate for each of its 4 surfaces. So the image is the
    exact one of a scene whose lengths, directions and indices are off by less than 64 roundings; of
    three such scenes the one farthest away counts, number by number. Colours are sums of less than
    100 terms with two or three roundings each: 256.

    The bound is wide only beside edges and in curved mirrors: for 97 % of all numbers it is below
    1e-9 in double precision, and below 1e-3 in single.
    """
    epsilon = EPSILON[precision]
    scale = scale or length_scale(numbers)
    near = (jiggled(numbers, seed, 64 * epsilon, scale) for seed in range(3))
    spread = np.max([abs(render(scene_of(scene, other)) - image) for other in near], axis=0)
    return 256 * epsilon * (1 + abs(image)) + spread


def check_derivatives(scene, numbers, agree=True, **options):
    """Image and derivatives are finite, and forward mode agrees with reverse mode."""
    values = scene_of(scene, numbers).parameters()
    tangents = directions(values)

    def image(values):
        return wt.render(scene.replace(values), max_depth=DEPTH, **options)

    assert np.isfinite(image(values).numpy()).all()
    forward = jvp(image, values, tangents)
    assert np.isfinite(forward).all()
    weights = np.random.default_rng(0).uniform(-1, 1, forward.shape)
    gradients = vjp(image, values, weights)
    assert not [name for name, value in gradients.items() if not np.isfinite(value).all()]
    if not agree:
        return
    there = weights * forward
    back = np.concatenate([gradients[name] * np.ravel(tangents[name]) for name in values])
    # Both sum the same products in another order, which are some 4000 a parameter: each sum is off
    # by no more roundings than it has terms
    size = np.sum(abs(there)) + np.sum(abs(back))
    assert abs(np.sum(there) - np.sum(back)) <= 4096 * EPSILON["double"] * size


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nothing", "floor", "ball", "glass", "mixed"])
@given(data=st.data())
def test_plain_derivatives_are_finite_and_agree(name, compiled, data):
    """With lights and cameras exactly on surfaces, and rays exactly along them."""
    layout = LAYOUTS[name]
    numbers = data.draw(scenes(layout, generic=False))
    check_derivatives(compiled(layout.plain_text), numbers, boundary=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ball", "glass"])
@one_of(5)
@given(data=st.data())
def test_derivatives_at_edges_are_finite_and_agree(name, compiled, data):
    """Of a fifth of the scenes, as finding edges takes longer. Where anything is exactly on a
    surface, roundings decide what the camera sees, and differently in the kernels of either mode.
    """
    layout, generic = LAYOUTS[name], data.draw(st.booleans(), label="generic")
    numbers = data.draw(scenes(layout, generic))
    check_derivatives(compiled(layout.plain_text), numbers, agree=generic)


@one_of(5)
@given(data=st.data())
def test_scene_is_what_the_contract_says(layout, compiled, data):
    """Of a fifth of the scenes, as one ray of the reference takes as long as all of an image."""
    numbers = data.draw(scenes(layout))
    text = f"max_depth = {DEPTH}\n" + layout.text(numbers)
    expected = Reference(text.replace("[24, 24]", "[5, 5]")).image()
    scene = compiled(layout.plain_text)

    def small(scene):
        return wt.render(scene, boundary=False, max_depth=DEPTH, resolution=(5, 5)).numpy()

    image = small(scene_of(scene, numbers))
    assert (abs(image - expected) <= tolerance(scene, numbers, image, render=small)).all()


def moved_far(numbers, moved, similarity):
    """The largest coordinate of a scene here or elsewhere, in units of here."""
    return max(length_scale(numbers), length_scale(moved) / similarity.scale)


@given(data=st.data())
def test_similarity_and_order_change_nothing(layout, compiled, data):
    """A scene that is turned, moved and scaled with its camera, and whose things are in another
    order, has the same picture.
    """
    scene = compiled(layout.plain_text)
    numbers = data.draw(scenes(layout))
    similarity = data.draw(similarities(layout, ROTATION))
    elsewhere = similarity(layout, numbers)
    image = plain(scene_of(scene, numbers))
    other = plain(scene_of(with_up(scene, ROTATION @ UP), elsewhere))
    scale = moved_far(numbers, elsewhere, similarity)
    assert (abs(other - image) <= tolerance(scene, numbers, image, scale=scale)).all()


@pytest.mark.parametrize("name", ["ball", "glass"])
@one_of(10)
@given(data=st.data())
def test_similarity_and_order_change_nothing_at_edges(name, compiled, data):
    """Of a tenth of the scenes."""
    layout = LAYOUTS[name]
    scene, numbers = compiled(layout.plain_text), data.draw(scenes(layout))
    similarity = data.draw(similarities(layout, ROTATION))
    elsewhere = similarity(layout, numbers)
    image = edged(scene_of(scene, numbers))
    other = edged(scene_of(with_up(scene, ROTATION @ UP), elsewhere))
    scale = moved_far(numbers, elsewhere, similarity)
    # The search for an edge ends with a step below 2^-23 of a pixel, which leaves its power of 1.6,
    # 1e-11 of a pixel, times the jump
    bound = tolerance(scene, numbers, image, scale=scale, render=edged) + 1e-10
    assert (abs(other - image) <= bound).all()


@one_of(2)
@given(data=st.data())
def test_lights_twice_as_bright_double_the_image(layout, compiled, data):
    """To the last bit, as twice is exact in binary numbers."""
    black = {"background": np.zeros(3), "ambient": np.zeros(3)}
    numbers = data.draw(scenes(layout, generic=False)) | black
    bright = {
        name: value * 2 if name.endswith("intensity") else value for name, value in numbers.items()
    }
    image, twice = (plain(scene_of(compiled(layout.plain_text), x)) for x in (numbers, bright))
    np.testing.assert_array_equal(twice, 2 * image)


def brightest(layout, numbers):
    """The most that one node of a tree can add, channel by channel."""
    light = np.zeros(3)
    for i in range(layout.lights):
        nearest = min(distances(layout, numbers, numbers[f"lights.light{i}.position"]), default=1)
        falls = layout.falloff(i) == "inverse-square"
        light += numbers[f"lights.light{i}.intensity"] / (max(nearest**2, 1e-300) if falls else 1)
    glow = [
        numbers[f"materials.m{i}.color"] * (numbers["ambient"] + light)
        + numbers[f"materials.m{i}.specular"] * light
        for i in range(len(layout.materials))
    ]
    return np.max([numbers["background"], *glow], axis=0)


def distances(layout, numbers, p):
    """How far a point is from each surface."""
    for i in range(layout.spheres):
        from_center = np.linalg.norm(p - numbers[f"spheres.sphere{i}.center"])
        yield abs(from_center - numbers[f"spheres.sphere{i}.radius"])
    for i in range(layout.planes):
        yield abs(numbers[f"planes.plane{i}.normal"] @ p + numbers[f"planes.plane{i}.offset"])


@one_of(2)
@given(data=st.data())
def test_another_bounce_adds_no_more_than_its_weight_allows(layout, compiled, data):
    """With half of each material's weights, a node's children together weigh no more than it."""
    numbers = {
        name: value / 2 if name.endswith(("reflection", "refraction")) else value
        for name, value in data.draw(scenes(layout)).items()
    }
    weights = [
        numbers[name] + numbers[name.replace("flec", "frac")]
        for name in numbers
        if name.endswith("reflection")
    ]
    scene = scene_of(compiled(layout.plain_text), numbers)
    shallow, deep = plain(scene), plain(scene, DEPTH + 1)
    most = max(weights, default=0) ** DEPTH * brightest(layout, numbers)
    # Either image is a sum of less than 100 colours
    rounding = 256 * EPSILON["double"] * (most + shallow)
    assert (abs(deep - shallow) <= most + rounding).all()


CLEAR = material("clear", refraction=1, ior=1) + sphere([0, 0, 0], 1, "clear")


def with_clear(compiled, layout, numbers, center, radius):
    """The scene with one more sphere, which is clear."""
    scene = scene_of(compiled(layout.plain_text + CLEAR), numbers)
    name = f"spheres.sphere{layout.spheres}"
    values = {f"{name}.center": center, f"{name}.radius": radius}
    old = scene.parameters(*values)
    return scene.replace({key: as_type(old[key], value) for key, value in values.items()})


@one_of(2)
@given(data=st.data())
def test_clear_sphere_among_matte_things_changes_nothing(layout, compiled, data):
    """A glass of index 1 that reflects nothing is not seen. There is no light that it could keep
    away, as glass throws a full shadow.
    """
    dark = ("reflection", "refraction", "intensity")
    numbers = {
        name: value * (not name.endswith(dark)) for name, value in data.draw(scenes(layout)).items()
    }
    extent = np.linalg.norm(numbers["camera.look_at"] - numbers["camera.position"])
    # Off the steps of all other numbers
    place = (np.array(data.draw(st.tuples(*[st.integers(-20, 20)] * 3))) + 0.123) / 10 * extent
    radius = data.draw(st.integers(1, 20)) / 10.1 * extent
    scene = compiled(layout.plain_text)
    image = plain(scene_of(scene, numbers))
    more = plain(with_clear(compiled, layout, numbers, place, radius))
    scale = length_scale(numbers | {"center": place, "radius": radius})
    assert (abs(more - image) <= tolerance(scene, numbers, image, scale=scale)).all()


@pytest.mark.parametrize("name", ["ball", "crowd"])
@one_of(2)
@given(data=st.data())
def test_clear_sphere_around_everything_changes_nothing(name, compiled, data):
    """Before a black sky: all that the sphere adds is one more node to rays that leave."""
    layout = LAYOUTS[name]
    scene, numbers = compiled(layout.plain_text), data.draw(scenes(layout))
    numbers |= {"background": np.zeros(3)}
    image = plain(scene_of(scene, numbers))
    more = plain(with_clear(compiled, layout, numbers, np.zeros(3), 1e5))
    assert (abs(more - image) <= tolerance(scene, numbers, image)).all()


@pytest.mark.parametrize("name", ["ball", "glass"])
@given(data=st.data())
def test_single_precision_agrees_with_double(name, compiled, data):
    layout = LAYOUTS[name]
    double, single = (compiled(layout.plain_text, each) for each in ("double", "single"))
    numbers = data.draw(scenes(layout))
    image = plain(scene_of(double, numbers))
    error = abs(plain(scene_of(single, numbers)) - image)
    assert (error <= tolerance(double, numbers, image, "single")).all()
