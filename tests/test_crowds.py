"""Pixels where edges crowd: what their samples and their edges count for."""

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from gradcheck import adjoint_error, image_error
from samples import camera, keys, light, material, plane, sphere

import whitted as wt
from whitted import gradient, load_scene, render
from whitted.edges import refinement, search, settings
from whitted.edges.kernels import crowds_everywhere
from whitted.edges.paths import partial_light
from whitted.edges.refinement import (
    crowd_side,
    pixels_to_refine,
    searches_crowds,
)
from whitted.edges.representation import representation
from whitted.rendering.job import BoundaryJob
from whitted.sampling.differentiated import prepare
from whitted.tracing.node import Limits
from whitted.tracing.primary import image_ray
from whitted.tracing.recursion import radiance

STEP = 1 / 8


def part_of(function, edges=(), step=STEP):
    """The part of the derivative of a sample at (0, 0), of radiance f(x, y).

    Args:
        edges: of the left, right, upper and lower neighbour those that are behind an edge.
    """

    def color(x, y):
        return ad.Array3f64(*(ad.Float64(function(x, y)) for _ in range(3)))

    at = {"left": (-step, 0), "right": (step, 0), "above": (0, -step), "below": (0, step)}
    seen = {way: (color(*place), ad.UInt(1 + (way in edges))) for way, place in at.items()}
    around = [(seen["left"], seen["right"]), (seen["above"], seen["below"])]

    def slope(dx, dy):
        h = 1e-6
        return (color(h * dx, h * dy) - color(-h * dx, -h * dy)) / (2 * h)

    own, slopes = (color(0, 0), ad.UInt(1)), (slope(1, 0), slope(0, 1))
    return representation(own, around, slopes, ad.Float64(step)).numpy()[0]


@pytest.mark.parametrize("edges", [(), ("left",), ("right", "above")])
def test_where_radiance_is_linear_a_sample_stands_for_its_cell(edges):
    # Roundings of numbers near 1, over 2e-6
    assert part_of(lambda x, y: 1 + x + 2 * y, edges) == pytest.approx(1, abs=1e-9)


def test_a_sample_on_a_streak_stands_for_what_its_neighbours_confirm():
    """Radiance rises by 1 within a tenth of the distance to the neighbours."""
    part = part_of(lambda x, y: 1 / (1 + np.exp(-x * 40 / STEP)))
    slope, mean = 10 / STEP, 0.5 / STEP
    # The streak's ends are 5e-9 away from 0 and 1
    assert part == pytest.approx(mean / slope, rel=1e-7)


def test_a_slope_against_that_of_the_neighbours_does_not_count():
    assert part_of(lambda x, y: 1 + np.sin(x * 3 * np.pi / 2 / STEP) / 4) == 0


def test_between_two_edges_radiance_changes_by_no_more_than_there_is():
    slope = 100
    part = part_of(lambda x, y: 1 + slope * x, ("left", "right"))
    assert part == pytest.approx(settings.MOST_CHANGE / STEP / slope, rel=1e-9)


@pytest.mark.parametrize("slope", [np.inf, np.nan])
def test_a_slope_that_is_not_finite_does_not_count(slope):
    """As beside a silhouette."""
    own = ad.Array3f64(1), ad.UInt(1)
    slopes = ad.Array3f64(slope), ad.Array3f64(0)
    assert representation(own, [(own, own)] * 2, slopes, ad.Float64(STEP)).numpy()[0] == 0


def test_dim_and_bright_light_are_all_light():
    """In nested glass, at a weight that splits the tree."""
    scene = load_scene("nested", precision="double")
    real = ad.Float64
    size = ad.Array2f64(8, 8)
    limits = Limits(8, ad.UInt(scene.max_depth), None, real(0.1))
    there, frame = prepare(scene.structure, scene.inputs(), size)
    x, y = dr.meshgrid(dr.arange(real, 8) + 0.5, dr.arange(real, 8) + 0.5)
    ray = image_ray(frame, size, x, y)
    whole = radiance(there, ray, limits).numpy()
    dim, bright = (
        partial_light(there, ray, limits, real(0.05), ad.Bool(dim)).numpy() for dim in (True, False)
    )
    # Sums of at most 2^5 terms
    np.testing.assert_allclose(dim + bright, whole, rtol=32 * 2.0**-52)
    assert dim.max() > 0.001


CHECKER = {"color": [0, 0, 0], "size": 0.2}
FLAT = (
    keys(ambient=[1, 1, 1])
    + camera([0, 1, 0], [0, 0.5, -3], fov=60, resolution=(32, 24))
    + material("f", color=[1, 1, 1], checker=CHECKER)
    + plane([0, 1, 0], 0, "f")
)


def crowded_pixels(monkeypatch, call):
    """The pixels where edges crowd, in the images that a call makes."""
    seen = []

    def noted(*given):
        seen.append(pixels_to_refine(*given))
        return seen[-1]

    monkeypatch.setattr(search, "pixels_to_refine", noted)
    result = call()
    monkeypatch.undo()
    return np.concatenate([crowd for _, crowd in seen]), result


@pytest.mark.parametrize("spp", [1, 4])
def test_a_crowded_pixel_is_the_mean_of_its_samples(load, monkeypatch, spp):
    loaded = load(FLAT)
    crowd, image = crowded_pixels(monkeypatch, lambda: render(loaded, spp).numpy())
    assert len(crowd) > 20
    samples = crowd_side(round(spp**0.5)) ** 2
    plain = render(loaded, samples, boundary=False).numpy().reshape(-1, 3)
    # Sums of as many numbers of at most 1, in another order
    tolerance = samples * 2.0**-52
    np.testing.assert_allclose(image.reshape(-1, 3)[crowd], plain[crowd], rtol=0, atol=tolerance)


def test_few_labels_meet_and_many_crowd(load, monkeypatch):
    """Where only two balls' outlines cross, all pixels are searched as before."""
    text = (
        keys(ambient=[1, 1, 1])
        + camera([0, 0, 4], fov=40, resolution=(24, 18))
        + material("a", color=[1, 0, 0])
        + material("b", color=[0, 1, 0])
        + sphere([-0.4, 0, 0], 0.7, "a")
        + sphere([0.5, 0.1, 0.8], 0.6, "b")
    )
    crowd, _ = crowded_pixels(monkeypatch, lambda: render(load(text), 4))
    assert not crowd.size


MIRRORS = (
    keys(background=[0.2, 0.3, 0.5], max_depth=4)
    + camera([0.1, 0.9, 4.2], [0, 0.1, 0], fov=38, resolution=(24, 16))
    + material("chrome", color=[0.05] * 3, specular=0.5, shininess=60, reflection=0.8)
    + material("floor", color=[0.5] * 3, checker={"color": [0.2, 0.2, 0.25], "size": 0.5})
    + plane([0, 1, 0], 0.5, "floor")
    + sphere([-0.62, 0.02, 0.0], 0.5, "chrome")
    + sphere([0.62, 0.05, -0.2], 0.55, "chrome")
    + light([-1.5, 3, 2.5], [0.9, 0.9, 0.9])
)


@pytest.mark.parametrize("precision", ["single", "double"])
def test_derivatives_of_crowds_agree_in_both_modes(load, monkeypatch, precision):
    loaded = load(MIRRORS, precision)
    names = "spheres.*.center", "planes.plane0.offset"
    crowd, _ = crowded_pixels(monkeypatch, lambda: render(loaded, 4))
    assert len(crowd) > 20
    values = loaded.parameters(*names)
    tangents = {name: np.arange(1, 1 + dr.size_v(value)) for name, value in values.items()}
    error = adjoint_error(lambda moved: render(loaded.replace(moved), 4), values, tangents)
    assert error < (1e-4 if precision == "single" else 1e-12)


def test_crowds_in_chunks_are_the_crowds_in_one(load, monkeypatch):
    loaded = load(MIRRORS)

    def computed():
        slope = gradient(loaded, "spheres.sphere0.radius", spp=4).numpy()
        return render(loaded, 4).numpy(), slope

    image, slope = computed()
    for module in (settings, refinement.settings):
        monkeypatch.setattr(module, "SAMPLES", 4000)
        monkeypatch.setattr(module, "LANES", 1 << 9)
    parts, slopes = computed()
    np.testing.assert_array_equal(parts, image)
    # Sums over a pixel's samples and edges, in another order
    np.testing.assert_allclose(slopes, slope, rtol=1e-10, atol=1e-12 * np.abs(slope).max())


def test_the_derivative_of_a_crowd_comes_closer_with_the_samples(load):
    loaded = load(MIRRORS)
    name = "spheres.sphere0.center"
    sharp = gradient(loaded, name, "x", 64).numpy()
    errors = [image_error(gradient(loaded, name, "x", spp).numpy(), sharp) for spp in (1, 4, 16)]
    assert errors[0] > errors[1] > errors[2], errors
    # An answer of 0 is off by 1
    assert errors[1] < 0.3, errors


def test_among_much_glass_crowds_have_four_times_the_samples_and_are_not_searched():
    def band(count):
        rows = np.random.default_rng(0).uniform(0.1, 1, (count, 4))
        glass = wt.Material("glass", refraction=1)
        eye = wt.Camera(position=(0, 0, 5), look_at=(0, 0, 0), fov=40, resolution=(16, 16))
        scene = wt.Scene(eye, clouds=[wt.Cloud(spheres=rows, material=glass)])
        job = BoundaryJob(scene, scene.given, (16, 16), 2, 4, None)
        return job.band(0, 16)

    few, many = band(settings.MOST_SEARCHED), band(settings.MOST_SEARCHED + 1)
    assert [crowds_everywhere(own.structure) for own in (few, many)] == [False, True]
    assert [searches_crowds(own) for own in (few, many)] == [True, False]
    assert crowd_side(4, everywhere=True) == 8
