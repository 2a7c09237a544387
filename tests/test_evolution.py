"""Evolution of numbers towards a lower loss."""

import numpy as np
import pytest

from whitted.inverse.evolution import SMALL, evolve


def run(loss, count, deviation=0.5, evaluations=4000, seed=0, late=lambda: False):
    lowest, x = evolve(loss, count, deviation, evaluations, np.random.default_rng(seed), late)
    assert lowest == loss(x) or not np.isfinite(lowest)
    return x


@pytest.mark.parametrize("count", [1, 2, 5, 12])
def test_finds_the_lowest_of_a_skewed_bowl(count):
    """Its axes are as unlike as 1 and 100, along none of the numbers."""
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(count, count)))[0]
    stretch = np.geomspace(1, 100, count)
    target = np.linspace(1, 2, count)
    found = run(lambda x: float((((x - target) @ axes * stretch) ** 2).sum()), count)
    # The last generation is as wide as SMALL in each number, and wider along the longest axis
    assert np.abs(found - target).max() < 5 * SMALL * count**0.5


def test_follows_a_curved_valley():
    """Rosenbrock's function of four numbers, from 0."""

    def loss(x):
        return float((100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2).sum())

    np.testing.assert_allclose(run(loss, 4), 1, atol=0.02)


def test_passes_over_what_is_rough():
    """A bowl with fifteen local minima along each number from the lowest to 1.5 beside it."""

    def loss(x):
        return float(((x - 3) ** 2 + 0.05 * (1 - np.cos(60 * (x - 3)))).sum())

    found = [run(loss, 3, 1.0, seed=seed) for seed in range(10)]
    # Further away the bowl has risen by more than the ripples' height
    near = [np.abs(x - 3).max() < 0.1**0.5 for x in found]
    assert np.mean(near) >= 0.8


def test_what_is_not_finite_is_never_the_lowest():
    def loss(x):
        return [float((x**2).sum()), np.nan, -np.inf][int(x[0] > 0.5) + int(x[0] > 0.6)]

    assert np.abs(run(loss, 2)).max() < 5 * SMALL
    np.testing.assert_array_equal(run(lambda x: np.nan, 2), [0, 0])


def test_ends_when_it_is_late_or_has_had_its_evaluations():
    calls = []

    def loss(x):
        calls.append(x)
        return float(((x - 1) ** 2).sum())

    run(loss, 5, late=lambda: True)
    # 4 + 3 log 5, a generation, and the loss that `run` asks for
    assert len(calls) == 8 + 1
    best = run(loss, 5, evaluations=100)
    assert len(calls) == 9 + 96 + 1
    assert ((best - 1) ** 2).sum() == min(((x - 1) ** 2).sum() for x in calls[9:])
