"""A tree of boxes around many spheres, built and kept up to date on the host.

The tree is binary. Its leaves are spheres, and each inner node has a box around all that is below
it. Neighbours on a curve that fills space are merged in rounds, those first whose common box is
small. Where merging comes to little, as with spheres around one center, neighbours are merged in
any case. So the tree is never deeper than `DEPTH`.

Source: D. Meister, J. Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy
Construction", IEEE TVCG 24 (2018).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

# Rounds of merging, and so inner nodes on the way to a leaf, at most
DEPTH = 48
# How far along the curve a node looks for the neighbour that it merges with
WINDOW = 8
# A round merges at least this part of the nodes; else neighbours are merged in any case
LEAST_MERGED = 1 / 8
# The boxes of spheres that have moved stay as they are arranged, while the spheres have moved by
# less than this part of their mean distance, and the boxes have grown by less than this factor
MOST_MOVED, MOST_GROWN = 1 / 2, 1.1

# Numbers of a node: the box's low corner; its high corner, negated; a link; and the node after it.
# A leaf has a sphere's center and radius in place of the box.
RECORD = 8
# The link of a leaf: this bit, and the number of its sphere. That of an inner node is the place of
# its first child; the second follows.
LEAF = 1 << 31
# The place behind the last node
END = 0xFFFFFFFF


@dataclass(frozen=True)
class Hierarchy:
    """The tree. Its nodes but the root stand in pairs, which have one parent."""

    members: np.ndarray  # the numbers of its spheres
    children: (
        np.ndarray
    )  # (2, N - 1): below N the place of a sphere in `members`, else an inner node
    rounds: tuple[int, ...]  # the number of inner nodes after each round
    links: np.ndarray  # (2 N - 2, 2): link and node after, of each node but the root
    records: np.ndarray  # (2 N - 2, RECORD)
    spheres: np.ndarray  # (N, 4): centers and radii of the members, when the tree was built
    cost: float  # sum of the boxes' areas, over that of the largest box, when the tree was built


def build(spheres: np.ndarray, members: np.ndarray) -> Hierarchy:
    """Build a tree.

    Args:
        spheres: (N, 4), centers and radii, in the precision of the kernels.
        members: the numbers of those that can be met.
    """
    own = spheres[members]
    if len(own) < 2:
        return _of_few(own, members)
    children, rounds = _merged(own)
    links = _links(children, rounds, members)
    whole = Hierarchy(members, children, rounds, links, np.empty(0), own, 0.0)
    records, cost = _records(whole, own)
    return replace(whole, records=records, cost=cost)


def moved(tree: Hierarchy, spheres: np.ndarray, members: np.ndarray) -> Hierarchy:
    """The tree of spheres that have moved: arranged as before if that is good enough, or new."""
    if not np.array_equal(members, tree.members):
        return build(spheres, members)
    own = spheres[members]
    if len(own) < 2:
        return _of_few(own, members)
    extent = np.ptp(own[:, :3], 0).max()
    distance = np.abs(own[:, :3] - tree.spheres[:, :3]).mean()
    if distance > MOST_MOVED * extent / len(own) ** (1 / 3):
        return build(spheres, members)
    records, cost = _records(tree, own)
    if cost > MOST_GROWN * tree.cost:
        return build(spheres, members)
    return replace(tree, records=records)


def _of_few(own: np.ndarray, members: np.ndarray) -> Hierarchy:
    """The tree of one sphere or none: a pair, filled up with spheres that no ray meets."""
    records = np.full((2, RECORD), np.nan, own.dtype)
    records[: len(own), :4] = own
    numbers = np.zeros(2, int)
    numbers[: len(own)] = members
    links = np.stack([numbers | LEAF, [1, END]], 1)
    _integers(records)[:, 6:] = links
    none = np.empty((2, 0), int)
    return Hierarchy(members, none, (), links, records, own, 0.0)


def _merged(own: np.ndarray) -> tuple[np.ndarray, tuple[int, ...]]:
    """The children of all inner nodes, and the number of inner nodes after each round."""
    n = len(own)
    order = _along_curve(own[:, :3])
    low = np.ascontiguousarray((own[:, :3] - own[:, 3:])[order].T)
    high = np.ascontiguousarray((own[:, :3] + own[:, 3:])[order].T)
    node, children, made = order, np.empty((2, n - 1), int), 0
    rounds: list[int] = []
    while len(node) > 1:
        first, second = _mates(low, high, DEPTH - len(rounds))
        count = len(first)
        children[:, made : made + count] = node[first], node[second]
        low[:, first] = np.minimum(low[:, first], low[:, second])
        high[:, first] = np.maximum(high[:, first], high[:, second])
        node[first] = n + made + np.arange(count)
        stays = np.ones(len(node), bool)
        stays[second] = False
        node, low, high = node[stays], low[:, stays], high[:, stays]
        made += count
        rounds.append(made)
    return children, tuple(rounds)


def _mates(low: np.ndarray, high: np.ndarray, left: int) -> tuple[np.ndarray, np.ndarray]:
    """The nodes that a round merges: each is the other's best neighbour.

    Args:
        low, high: (3, N), the boxes' corners, in their order along the curve.
        left: rounds that are left.
    """
    n = low.shape[1]
    if n <= 1 << (left - 1):
        best, mate = np.full(n, np.inf, low.dtype), np.zeros(n, int)
        for k in range(1, min(WINDOW, n - 1) + 1):
            x, y, z = np.maximum(high[:, k:], high[:, :-k]) - np.minimum(low[:, k:], low[:, :-k])
            area = x * (y + z) + y * z
            for side, step in ((slice(None, -k), k), (slice(k, None), -k)):
                better = area < best[side]
                best[side][better], mate[side][better] = area[better], step
        mate += np.arange(n)
        first = np.flatnonzero((mate > np.arange(n)) & (mate[mate] == np.arange(n)))
        if len(first) > LEAST_MERGED * n:
            return first, mate[first]
    first = np.arange(0, n - 1, 2)
    return first, first + 1


def _along_curve(points: np.ndarray) -> np.ndarray:
    """The order of points along G. Morton's curve, which interleaves the bits of coordinates."""
    low = points.min(0)
    extent = float((points - low).max()) or 1.0
    cells = ((points - low) / extent * (2**21 - 1)).astype(np.uint64)
    steps = (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    )
    code = np.zeros(len(points), np.uint64)
    for axis in range(3):
        spread = cells[:, axis]
        for shift, mask in steps:
            spread = (spread | spread << np.uint64(shift)) & np.uint64(mask)
        code |= spread << np.uint64(axis)
    return np.argsort(code, kind="stable")


def _links(children: np.ndarray, rounds: tuple[int, ...], members: np.ndarray) -> np.ndarray:
    """Where each node but the root leads to: its children or sphere, and the node after it."""
    inner = children.shape[1]
    n = inner + 1
    # The last inner node is the root, whose children are the first pair
    first = 2 * (inner - 1 - np.arange(inner))
    after = np.full(inner, END)
    links = np.empty((2 * inner, 2), int)
    starts = (0, *rounds[:-1])
    for start, stop in zip(reversed(starts), reversed(rounds), strict=True):
        own = slice(start, stop)
        for child, place, next_place in (
            (children[0, own], first[own], first[own] + 1),
            (children[1, own], first[own] + 1, after[own]),
        ):
            below = child >= n
            after[child[below] - n] = next_place[below]
            leads = first[np.maximum(child - n, 0)], members[np.minimum(child, n - 1)] | LEAF
            links[place, 0] = np.where(below, *leads)
            links[place, 1] = next_place
    return links


def _records(tree: Hierarchy, own: np.ndarray) -> tuple[np.ndarray, float]:
    """The nodes for kernels, and the sum of the boxes' areas over that of the largest box."""
    n = len(own)
    boxes = np.zeros((2 * n - 1, RECORD), own.dtype)
    # Half a rounding of a center, of a radius and of their sum, and some to spare
    edge = 4 * np.finfo(own.dtype).eps * (np.abs(own[:, :3]) + own[:, 3:]) + own[:, 3:]
    boxes[:n, :3] = own[:, :3] - edge
    boxes[:n, 3:6] = -own[:, :3] - edge
    starts = (0, *tree.rounds[:-1])
    for start, stop in zip(starts, tree.rounds, strict=True):
        one, two = (boxes.take(child[start:stop], 0) for child in tree.children)
        boxes[n + start : n + stop] = np.minimum(one, two)
    x, y, z = -(boxes[n:, :3] + boxes[n:, 3:6]).T
    area = x * (y + z) + y * z
    # The pair of the root comes first
    child = tree.children[:, ::-1].T.ravel()
    records = boxes.take(child, 0)
    leaf = np.flatnonzero(child < n)
    records[leaf, :4] = own[child[leaf]]
    _integers(records)[:, 6:] = tree.links
    return records, float(area.sum(dtype=float) / (area[-1] or 1))


def _integers(records: np.ndarray) -> Any:
    """The same memory as integers."""
    return records.view({4: np.uint32, 8: np.uint64}[records.itemsize])
