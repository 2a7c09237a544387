"""The bookkeeping of edges on small grids whose answers can be counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from whitted.core.host import PACKET
from whitted.edges.grid import band_samples, fine_samples, label_counts, neighbours_across_edges
from whitted.edges.pairs import Crossings, Pairs, interleaved, pairs_of, walk_order
from whitted.edges.quadrature import Interval, intervals_beside, nodes, samples_beside
from whitted.edges.refinement import candidates
from whitted.edges.settings import SHARES
from whitted.edges.tables import deposit

# 2 x 2 pixels with a margin of one; the label changes between the second column and the third
STEP = np.array([[1, 1, 2, 2]] * 4, np.uint32)


def dense_pairs(labels, side=1, first_row=0) -> Pairs:
    samples = band_samples(labels, side, first_row)
    return pairs_of(samples, *neighbours_across_edges(samples))


def test_pairs_lie_across_a_vertical_edge():
    pairs = dense_pairs(STEP, first_row=10)
    # Rows 0 and 3 are margin; in the others the edge is between the pixels 0 and 1, 2 and 3
    assert pairs.pixel.T.tolist() == [[0, 1], [2, 3]]
    assert pairs.sample.T.tolist() == [[5, 6], [9, 10]]
    assert list(zip(pairs.x.tolist(), pairs.y.tolist(), strict=True)) == [(0.5, 10.5), (0.5, 11.5)]
    assert not pairs.vertical.any()
    assert pairs.label.T.tolist() == [[1, 2]] * 2


def test_pairs_lie_across_a_horizontal_edge_and_into_the_margin():
    labels = np.array([[1] * 4, [2] * 4, [2] * 4, [2] * 4], np.uint32)
    pairs = dense_pairs(labels)
    assert pairs.vertical.all()
    assert pairs.pixel.T.tolist() == [[-1, 0], [-1, 1]]
    assert pairs.y.tolist() == [-0.5, -0.5]


def edges_of(pairs, singular, weight) -> Crossings:
    """An edge midway in each of the pairs."""
    n = len(pairs)
    none = np.zeros((3, n))
    return Crossings(
        np.arange(n),
        pairs.length / 2,
        none,
        none[:2],
        np.full(n, weight),
        singular,
        np.ones(n, bool),
    )


@pytest.mark.parametrize("both", [True, False])
def test_a_sample_between_two_edges_is_taken_whole(both):
    """Two singular edges take half of the sample between them each; a single one takes all, as the
    sample may be close to that.
    """
    pairs = dense_pairs(np.array([[1, 2, 3, 3]] * 4, np.uint32))
    pixels = [[-1, 0], [-1, 2], [0, 1], [2, 3]]
    assert pairs.pixel.T.tolist() == pixels
    singular = np.array([both, both, True, True])
    lines, pair, taken = intervals_beside(
        edges_of(pairs, singular, 1.0), pairs, pairs.ends(np.flatnonzero(singular))
    )
    assert pairs.pixel.T[pair].tolist() == (pixels if both else pixels[2:])
    assert taken.T.tolist() == ([[0, 0.5]] * 2 + [[0.5, 1]] * 2 if both else [[1, 1]] * 2)
    assert lines.start.tolist() == ([-0.5] * 2 + [0] * 2 if both else [-0.5] * 2)
    assert lines.stop.tolist() == ([1] * 2 + [1.5] * 2 if both else [1.5] * 2)


@pytest.mark.parametrize(("weight", "taken"), [(0.2, 0), (0.3, 0), (0.5, 0.5), (0.7, 1), (0.8, 1)])
def test_pairs_across_an_edge_take_what_pairs_along_it_leave(weight, taken):
    pairs = dense_pairs(STEP)
    every = np.ones(len(pairs), bool)
    lines, _, parts = intervals_beside(
        edges_of(pairs, every, weight), pairs, pairs.ends(np.arange(len(pairs)))
    )
    # A share of 0.2 or 0.4 is a difference of numbers below 1
    np.testing.assert_allclose(parts, taken, rtol=0, atol=1e-15)
    np.testing.assert_allclose(lines.weight, taken, rtol=0, atol=1e-15)


def test_labels_of_two_halves_differ_in_both():
    """A label has two halves where weights depend on the angle. A node that begins to weigh enough
    changes one half only, and is no edge.
    """
    one = STEP.astype(np.uint64)
    for labels, edges in (
        (one, 0),
        (one << 32, 0),
        (one | one << 32, 2),
        (one | STEP.T.astype(np.uint64) << 32, 0),
    ):
        assert len(dense_pairs(labels)) == edges
    samples = band_samples(one | one << 32, 1, 0)
    assert label_counts(samples, np.arange(4)).tolist() == [2] * 4
    assert label_counts(replace(samples, labels=one[None]), np.arange(4)).tolist() == [1] * 4


def test_several_samples_a_pixel():
    labels = np.ones((8, 8), np.uint32)
    labels[:, 5:] = 2
    pairs = dense_pairs(labels, 2)
    # Between the two samples of the right pixels
    assert pairs.pixel.T.tolist() == [[1, 1], [1, 1], [3, 3], [3, 3]]
    assert pairs.length.tolist() == [0.5] * 4
    assert set(pairs.x.tolist()) == {1.25}


def test_labels_are_counted_among_the_nearest():
    labels = np.array([[9, 1, 1, 9], [1, 1, 2, 2], [3, 3, 2, 2], [9, 3, 2, 9]], np.uint32)
    samples = band_samples(labels, 1, 0)
    # Pixel 0 sees 1, 2, 3; pixel 1 sees 1, 2; pixel 2 sees 1, 2, 3; pixel 3 only 2 and 3; corners
    # do not count
    assert label_counts(samples, np.arange(4)).tolist() == [3, 2, 3, 2]


def test_pixels_with_three_labels_are_candidates():
    labels = np.array([[1, 1, 1, 1], [1, 2, 1, 1], [1, 1, 1, 1], [1, 1, 1, 1]], np.uint32)
    samples = band_samples(labels, 1, 0)
    # Four pairs surround pixel 0, of which its neighbours have one each
    assert candidates(neighbours_across_edges(samples)[2], 1).tolist() == [0]


@pytest.mark.parametrize(("side", "pixels"), [(1, [3, 5]), (2, [3, 5, 7])])
def test_one_edge_at_a_single_sample_does_not_crowd_it(side, pixels):
    ends = np.array([[3, -1, 3, 5], [5, 3, 7, -1]], np.int32)
    assert candidates(ends, side).tolist() == pixels
    assert candidates(ends[:, :0], side).tolist() == []


def test_finer_samples_fill_a_pixel_with_a_ring_around_it():
    samples, traced = fine_samples(np.array([5]), 2, 4, first_row=3)
    np.testing.assert_array_equal(samples.x.reshape(4, 4), [[0.75, 1.25, 1.75, 2.25]] * 4)
    np.testing.assert_array_equal(
        samples.y.reshape(4, 4), np.array([[3.75, 4.25, 4.75, 5.25]] * 4).T
    )
    assert (samples.pixel >= 0).sum() == 4
    # All but the corners
    assert sorted({0, 3, 12, 15} | set(traced.tolist())) == list(range(16))
    assert len(traced) == 12


@pytest.mark.parametrize(("step", "columns"), [(1, 4), (4, 4)])
def test_finer_samples_of_neighbours_are_traced_once(step, columns):
    """The rings of two pixels side by side, or one above the other, share four samples."""
    samples, traced = fine_samples(np.array([5, 5 + step]), 2, columns, first_row=0)
    assert len(traced) == 24 - 4
    assert samples.x.tolist() == samples.x.take(samples.twin).tolist()
    assert samples.y.tolist() == samples.y.take(samples.twin).tolist()
    assert set(samples.twin[np.delete(np.arange(32), traced)].tolist()) <= {
        *traced.tolist(),
        0,
        3,
        12,
        15,
        16,
        19,
        28,
        31,
    }
    # Not of the last pixel of a row and the first of the next
    assert len(fine_samples(np.array([3, 4]), 2, 4, first_row=0)[1]) == 24
    # An edge between them is found once, by the first, and belongs to both
    labels = (
        np.where(samples.pixel.take(samples.twin) == 5 + step, 2, 1)
        .astype(np.uint32)
        .reshape(2, 4, 4)
    )
    labels[1] = [[2, 2, 2, 3]] * 4 if step == 1 else [[2] * 4] * 3 + [[3] * 4]
    samples = replace(samples, labels=labels)
    pairs = pairs_of(samples, *neighbours_across_edges(samples))
    assert sorted(pairs.pixel.T.tolist()) == [[5, 5 + step]] * 2 + [[5 + step, -1]] * 2
    assert set(pairs.sample[1][pairs.pixel[1] >= 0].tolist()) == (
        {21, 25} if step == 1 else {21, 22}
    )


def test_finer_pairs_count_only_in_their_pixel():
    labels = np.array([[[1, 2, 2, 3]] * 4], np.uint32)
    samples = replace(fine_samples(np.array([5]), 2, 4, first_row=0)[0], labels=labels)
    pairs = pairs_of(replace(samples, first=100), *neighbours_across_edges(samples))
    assert pairs.pixel.T.tolist() == [[-1, 5]] * 2 + [[5, -1]] * 2
    assert pairs.sample.T.tolist() == [[104, 105], [108, 109], [106, 107], [110, 111]]
    assert pairs.length.tolist() == [0.5] * 4


def test_values_of_one_pixel_add_up_and_those_of_none_are_dropped():
    image = np.zeros(6)
    deposit(
        image,
        np.array([[2, -1], [2, 0]]),
        np.array([[1.0, 2], [3, 4]]),
        np.array([[10.0, 20], [30, 40]]),
    )
    np.testing.assert_array_equal(image, [4, 40, 0, 0, 4, 40])


def test_lanes_are_dealt_out_packet_by_packet():
    order = np.arange(4 * SHARES * PACKET + 5)
    lanes = interleaved(order)
    packets = lanes[:-5].reshape(SHARES, 4, PACKET)
    # Each share has packets from all parts of the order, in order; what is left over comes last
    np.testing.assert_array_equal(packets[..., 0] // (SHARES * PACKET), [[0, 1, 2, 3]] * SHARES)
    assert (np.diff(packets) == 1).all()
    np.testing.assert_array_equal(np.sort(lanes), order)
    np.testing.assert_array_equal(lanes[-5:], order[-5:])


def test_walks_through_equal_trees_come_together():
    labels = np.uint32([9, 0xFFFF0003, 9, 0x10001])
    order = walk_order(labels, few_alike=False)
    assert np.argsort(order, kind="stable").tolist() == [3, 1, 0, 2]
    assert order.dtype == np.uint16


def test_walks_keep_their_places_where_few_trees_are_equal():
    assert not walk_order(np.uint32([9, 0xFFFF0003, 9]), few_alike=True).any()


def interval(edge, rooted, length=0.5) -> Interval:
    """From the far end of the cell of a sample at (3, 2) to that of the one below it."""
    numbers = (3.0, 2.0, True, length, edge, -length / 2, 1.5 * length, rooted, 2.0)
    return Interval(*(np.array([number]) for number in numbers))


@pytest.mark.parametrize("rooted", [True, False])
@pytest.mark.parametrize("edge", [0.05, 0.25, 0.4])
@pytest.mark.parametrize("pieces", [1, 4])
def test_samples_beside_an_edge_stand_for_both_cells(edge, rooted, pieces):
    """Each pixel's weights add up to its length, and all samples are on the line, on the side that
    they stand for.
    """
    x, y, weight, in_b, behind = nodes(interval(edge, rooted), pieces)
    # Sums of up to 17 weights
    np.testing.assert_allclose([weight[~in_b].sum(), weight[in_b].sum()], 2 * 0.5, rtol=1e-14)
    assert np.all(x == 3)
    assert np.array_equal(y > 2 + edge, behind)
    assert weight[behind].sum() == pytest.approx(2 * (0.75 - edge), rel=1e-14)


@pytest.mark.parametrize("rooted", [True, False])
@pytest.mark.parametrize("pieces", [1, 4])
def test_samples_beside_an_edge_integrate_the_square_root(rooted, pieces):
    """The rule is exact for a + b sqrt(distance) + c distance on one side of an edge midway,
    and for a line on the other.
    """
    _, y, weight, _, behind = nodes(interval(0.25, rooted), pieces)
    distance = abs(y - 2.25)
    seen = np.where(behind == rooted, 1 + 3 * np.sqrt(distance) + 5 * distance, 7 - 2 * distance)
    # Integrals from 0 to 1 / 2
    exact = 2 * (0.5 + 3 * 2 / 3 * 0.5**1.5 + 5 / 2 * 0.25 + 7 * 0.5 - 0.25)
    # Gauss's points have 16 digits
    assert (seen * weight).sum() == pytest.approx(exact, rel=1e-14)


def test_samples_beside_an_edge_count_for_the_pixel_that_they_are_in():
    line = interval(0.05, True)
    order = np.array([[10], [20]], np.uint16)
    samples = samples_beside(line, 1, np.array([[4], [-1]]), order, np.array([[1.0], [0.5]]))
    # The smooth side of a, and between the edge and the border, which is behind the edge
    assert samples.pixel.tolist() == [4, 4]
    assert samples.order.tolist() == [20, 10]
    assert samples.weight.sum() == pytest.approx(1, rel=1e-15)
