"""Walks to a node of the tree of rays, against the whole tree."""

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad
from samples import SCENES

from whitted.edges.labels import labelled_radiance
from whitted.edges.paths import Path, contrasted
from whitted.sampling.differentiated import prepare
from whitted.tracing.node import Limits
from whitted.tracing.primary import image_ray

SIDE = 24


def looked(load, text, faint, path=None):
    """Radiance and labels of samples: what is contrasted below a path's node, or all."""
    loaded = load(text)
    scene, frame = prepare(loaded.structure, loaded.inputs(), ad.Array2f64(SIDE, SIDE))
    j, i = np.divmod(np.arange(SIDE**2), SIDE)
    ray = image_ray(frame, ad.Array2f64(SIDE, SIDE), ad.Float64(i + 0.5), ad.Float64(j + 0.5))
    least = ad.Float64(loaded.min_importance) if loaded.min_importance else None
    limits = Limits(loaded.max_depth, ad.UInt32(loaded.max_depth), least, ad.Float64(faint))
    color, label = (
        contrasted(scene, ray, path, limits) if path else labelled_radiance(scene, ray, limits)
    )
    return color.numpy(), label.numpy()


def path(bounces, turns=0):
    width = SIDE**2
    return Path(dr.full(ad.UInt32, bounces, width), dr.full(ad.UInt64, turns, width))


@pytest.mark.parametrize(
    "name",
    [
        "all",
        "mirrors",
        "bubble in glass, ball in water",
        "least importance",
        "diffuse under two lights",
    ],
)
def test_all_light_counts_below_the_first_node_and_where_nothing_is_faint(load, name):
    for faint, way in ((0.2, path(0)), (0.0, path(100))):
        color, label = looked(load, SCENES[name], faint, way)
        whole, labels = looked(load, SCENES[name], faint)
        np.testing.assert_array_equal(label, labels)
        np.testing.assert_array_equal(color, whole)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_what_is_left_out_is_faint_and_off_the_path(load, turns):
    """Labels stay those of all rays, and the farther up a node is, the less light is missing."""
    text, faint = SCENES["all"], 0.2
    whole, labels = looked(load, text, faint)
    missing = []
    for bounces in range(4):
        color, label = looked(load, text, faint, path(bounces, turns))
        np.testing.assert_array_equal(label, labels)
        missing.append(whole - color)
        # Nothing is added but roundings of sums of a few dozen colours
        assert missing[-1].min() > -1e-14
    steps = np.diff(missing, axis=0)
    assert steps.min() > -1e-14
    assert steps.max() > 1e-3
