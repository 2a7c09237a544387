"""Benchmarks that look into the package do so here in small."""

import sys
from pathlib import Path

import drjit as dr
from samples import camera, keys, material, plane

from whitted import render

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import boundary


def test_crossings_of_one_straight_edge_are_counted(load):
    """A crease from the top of the picture to its bottom crosses each of its 12 rows of samples
    once.
    """
    white, red = material("white", color=[0.9, 0.8, 0.7]), material("red", color=[0.7, 0.1, 0.2])
    walls = plane([1, 0, 0], 0.01, "white") + plane([0, 0, 1], 1, "red")
    loaded = load(keys(ambient=[1, 1, 1]) + camera([1, 0, 2], [0, 0, 0]) + white + red + walls)

    def gradient():
        params = loaded.parameters("planes.plane0.offset")
        dr.enable_grad(params)
        dr.backward(dr.sum(render(loaded.replace(params), 1).array))
        return params["planes.plane0.offset"].grad

    assert boundary.crossings(gradient) == 12
