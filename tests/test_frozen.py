"""Recorded functions: what they take apart and put together, and when they trace again."""

import gc
from dataclasses import dataclass

import drjit as dr
import numpy as np
import pytest
from drjit.llvm import ad

import whitted as wt
from whitted.core.frozen import frozen


@dataclass
class Parcel:
    """Arrays and other values, some of them in other containers."""

    x: ad.Float
    name: str
    others: dict


def test_recording_is_replayed_for_arguments_of_the_same_structure():
    traced = []

    @frozen
    def doubled(parcel, pair):
        traced.append(parcel.name)
        a, nothing = pair
        return Parcel(
            parcel.x * 2, parcel.name + "!", {"sum": parcel.others["y"] + a, "same": (nothing, 7)}
        )

    def call(x, name, width):
        others = {"y": dr.arange(ad.Float, width)}
        return doubled(Parcel(dr.opaque(ad.Float, x), name, others), (dr.opaque(ad.Float, 1), None))

    for x, name, width, traces in (
        (1, "a", 3, ["a"]),
        (2, "a", 4, ["a"]),
        (2, "b", 4, ["a", "b"]),
        (5, "a", 3, ["a", "b"]),
    ):
        result = call(x, name, width)
        assert traced == traces
        assert type(result) is Parcel
        assert result.name == name + "!"
        assert result.x.numpy().tolist() == [2 * x]
        assert result.others["sum"].numpy().tolist() == [1 + k for k in range(width)]
        assert result.others["same"] == (None, 7)


def test_garbage_is_not_collected_while_a_function_is_recorded():
    """Freeing an array in NumPy's memory just then would end the process."""
    collects = []

    @frozen
    def doubled(x):
        collects.append(gc.isenabled())
        return x * 2

    assert doubled(dr.opaque(ad.Float, 3)).numpy() == [6]
    assert collects == [False]
    assert gc.isenabled()


def test_a_scene_is_the_same_after_a_function_that_the_user_freezes():
    """Within it, a scene's numbers are not known."""
    scene = wt.load_scene("cornell")
    name, size = "materials.white.color", {"resolution": (12, 8), "boundary": False}
    white = scene.parameters(name)[name]

    @dr.freeze
    def render(color):
        return wt.render(scene.replace({name: color}), **size)

    def numbers(color):
        return wt.render(scene.replace({name: color}), **size).numpy()

    for factor in (1, 0.5, 0.25):
        color = white * factor
        dr.make_opaque(color)
        frozen_image = render(color).numpy()
        np.testing.assert_array_equal(frozen_image, numbers(color))
    # Rendered there first, a scene that is not replaced stays the same
    fresh = wt.load_scene("cornell")
    darker = dr.freeze(lambda x: wt.render(fresh, **size) * x)
    darker(dr.opaque(ad.Float, 0.5))
    np.testing.assert_array_equal(
        wt.render(fresh, **size).numpy(), wt.render(scene, **size).numpy()
    )


def test_edges_are_not_recorded():
    """What is found on the host would be that of the first call, in every later one."""
    scene = wt.load_scene("cornell")
    frozen = dr.freeze(lambda x: wt.render(scene, resolution=(12, 8)) * x)
    with pytest.raises(RuntimeError) as caught:
        frozen(dr.opaque(ad.Float, 0.5))
    cause = caught.value.__cause__
    assert type(cause) is ValueError
    assert str(cause) == (
        "boundary: edges are found outside of kernels, and cannot be recorded; "
        "render with boundary=False in functions that dr.freeze records"
    )
    # All is as before
    assert np.isfinite(wt.render(scene, resolution=(12, 8)).numpy()).all()
