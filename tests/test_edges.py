"""The bookkeeping of edges on small grids whose answers can be counted by hand."""

import numpy as np
import pytest

from whitted.edges import contrasting, dense_pairs, deposit, fine_pairs, fine_positions, label_counts

# 2 x 2 pixels with a margin of one; the label changes between the second column and the third
STEP = np.array([[1, 1, 2, 2]] * 4, np.uint32)


def black(labels):
    return np.zeros((labels.size, 3), np.float32)


def test_pairs_lie_across_a_vertical_edge():
    pairs = dense_pairs(STEP, black(STEP), 1, first_row=10)
    # Rows 0 and 3 are margin; in the others the edge is between the pixels 0 and 1, 2 and 3
    assert pairs.pixel.tolist() == [[0, 1], [2, 3]]
    assert pairs.sample.tolist() == [[5, 6], [9, 10]]
    assert list(zip(pairs.x.tolist(), pairs.y.tolist(), strict=True)) == [(0.5, 10.5), (0.5, 11.5)]
    assert not pairs.vertical.any()
    assert pairs.alone.all()
    assert pairs.label.tolist() == [[1, 2]] * 2


def test_pairs_lie_across_a_horizontal_edge_and_into_the_margin():
    labels = np.array([[1] * 4, [2] * 4, [2] * 4, [2] * 4], np.uint32)
    pairs = dense_pairs(labels, black(labels), 1, first_row=0)
    assert pairs.vertical.all()
    assert pairs.pixel.tolist() == [[-1, 0], [-1, 1]]
    assert pairs.y.tolist() == [-0.5, -0.5]


def test_neighbours_of_an_edge_are_not_alone():
    labels = np.array([[1, 2, 3, 3]] * 4, np.uint32)
    pairs = dense_pairs(labels, black(labels), 1, first_row=0)
    assert pairs.pixel.tolist() == [[-1, 0], [0, 1]] + [[-1, 2], [2, 3]]
    # What is beyond a sample of the margin does not matter
    assert pairs.alone[pairs.pixel >= 0].tolist() == [False, False, True] * 2


def test_several_samples_a_pixel():
    labels = np.ones((8, 8), np.uint32)
    labels[:, 5:] = 2
    pairs = dense_pairs(labels, black(labels), 2, first_row=0)
    # Between the two samples of the right pixels
    assert pairs.pixel.tolist() == [[1, 1], [1, 1], [3, 3], [3, 3]]
    assert pairs.length.tolist() == [0.5] * 4
    assert set(pairs.x.tolist()) == {1.25}


@pytest.mark.parametrize(("least", "left"), [(0.4, 2), (0.6, 0)])
def test_pairs_without_contrast_are_left_out(least, left):
    colors = black(STEP)
    colors[STEP.ravel() == 2] = [0.5, 1, 1]
    colors[STEP.ravel() == 1] = [0.5, 0.5, 1]
    assert len(contrasting(dense_pairs(STEP, colors, 1, 0), least)) == left


def test_labels_are_counted_among_the_nearest():
    labels = np.array([[9, 1, 1, 9], [1, 1, 2, 2], [3, 3, 2, 2], [9, 3, 2, 9]], np.uint32)
    colors = np.ones((16, 3), np.float32)
    colors[::2] = 0.2
    # Pixel 0 sees 1, 2, 3; pixel 1 sees 1, 2; pixel 2 sees 1, 2, 3; pixel 3 only 2 and 3; corners do not count
    assert label_counts(labels, colors, 1, np.arange(4), 0.1).tolist() == [3, 2, 3, 2]
    # Without contrast edges that meet are not worth more samples
    assert label_counts(labels, np.ones((16, 3), np.float32), 1, np.arange(4), 0.1).tolist() == [1, 2, 1, 2]


def test_finer_samples_fill_a_pixel_with_a_ring_around_it():
    x, y = fine_positions(np.array([5]), columns=4, side=2, first_row=3)
    np.testing.assert_array_equal(x[0], [[0.75, 1.25, 1.75, 2.25]] * 4)
    np.testing.assert_array_equal(y[0], np.array([[3.75, 4.25, 4.75, 5.25]] * 4).T)


def test_finer_pairs_count_only_in_their_pixel():
    x, y = fine_positions(np.array([5]), columns=4, side=2, first_row=0)
    labels = np.array([[[1, 2, 2, 3]] * 4], np.uint32)
    pairs = fine_pairs(labels, np.zeros((16, 3)), x, y, np.array([5]), first=100)
    assert pairs.pixel.tolist() == [[-1, 5], [5, -1]] * 2
    assert pairs.sample.tolist() == [[104, 105], [106, 107], [108, 109], [110, 111]]
    assert pairs.length.tolist() == [0.5] * 4


def test_values_of_one_pixel_add_up_and_those_of_none_are_dropped():
    image = np.zeros((3, 3))
    deposit(image, np.array([[2, -1], [2, 0]]), np.arange(12.0).reshape(2, 2, 3))
    np.testing.assert_array_equal(image, [[9, 10, 11], [0, 0, 0], [6, 8, 10]])
