"""Benchmarks that look into the package do so here in small."""

import sys
from pathlib import Path

import drjit as dr
from samples import camera, keys, material, plane

from whitted import render

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import boundary
from recovery_problems import problem


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


def test_a_random_problem_is_solved_by_its_truth_alone():
    """Problem 9 asks for one number; it is the same one at every distance."""
    near, far = (problem(9, distance, 32) for distance in ("near", "far"))
    assert near.names == far.names
    for one in (near, far):
        assert one.solved(one.truth)
        assert not one.solved(one.start)
    assert far.errors(far.start).max() > 2 * near.errors(near.start).max()
    # Samples alone, as there is no noise in every third problem
    assert near.true_loss() < 1e-4
