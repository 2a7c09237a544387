"""Samples beside an edge, which integrate radiance in place of the two neighbours around it.

On the sphere's side of a silhouette the normal changes like the square root of the distance from
the edge, and so does radiance: a + b sqrt(distance) + c distance + ... Its derivative is a /
sqrt(distance) + b + ... The same holds where refraction ends in total reflection. On that side, two
of Gauss's points in sqrt(distance) integrate radiance up to the term in distance, and its
derivative as far. They also do better than samples where a surface that is met at a small angle
runs off into the distance between the two neighbours.

On the other side one sample in the middle is enough. The border between the neighbours' cells cuts
one of the two sides. The part between the border and the edge has a sample of its own.

Several edges may lie between the neighbours, for example where curved mirrors touch. What lies
between two such edges is small and bright. Each part is then cut into pieces with as many samples.
"""

from dataclasses import dataclass

import numpy as np

from .pairs import Crossings, Pairs
from .settings import SLIGHT
from .tables import rows_of


@dataclass(frozen=True)
class Interval:
    """The part of the line through two neighbours a and b that is nearest to one edge; a table.

    Distances are from a, in pixels, along the line.
    """

    x: np.ndarray  # image position of a
    y: np.ndarray
    vertical: np.ndarray  # bool: b is below a, not to the right
    length: np.ndarray  # from a to b
    edge: np.ndarray
    start: np.ndarray
    stop: np.ndarray
    behind: np.ndarray  # bool: the square root is behind the edge, not before it
    weight: np.ndarray  # in the pixel of a or of b, for a unit of length


@dataclass(frozen=True)
class Extra:
    """Samples beside edges, and those of pixels that are sampled anew; a table."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray
    weight: np.ndarray  # what the sample counts for in its pixel
    order: np.ndarray  # of `walk_order`


def intervals_beside(
    crossings: Crossings, pairs: Pairs, ends: np.ndarray
) -> tuple[Interval, np.ndarray, np.ndarray]:
    """The lines to sample anew: those of pairs with a singular edge.

    An interval goes halfway to the next crossing, or to the end of a sample's cell.

    Args:
        ends: `Pairs.ends` of all pairs with a singular edge.

    Returns:
        The intervals, the pair of each, and (2, N) the parts of the samples a and b that they
        replace.
    """
    singular = np.zeros(len(pairs), bool)
    singular[crossings.pair[crossings.singular]] = True
    found = rows_of(crossings, np.flatnonzero(singular[crossings.pair]))
    # By pair, then by distance, which is less than a pixel
    found = rows_of(found, np.argsort(found.pair + found.along / 2, kind="stable"))
    pair, c = found.pair, found.along
    here = rows_of(pairs, pair)
    h = here.length
    begins = np.diff(pair, prepend=-1) != 0
    last = np.roll(begins, -1)
    # Where the pair on the other side of a sample has a singular edge as well, each pair takes half
    # of the sample's cell
    a, b = pairs.ends(pair)
    before = np.where(_is_marked(ends[1], a), 0, h / 2)
    after = np.where(_is_marked(ends[0], b), 0, h / 2)
    # All crossings of a pair share one weight, so that its samples are replaced as a whole. Pairs
    # along an edge replace nothing, and those across it everything: a part of a sample close to the
    # edge would spoil the sum
    first = np.flatnonzero(begins)
    count = np.diff(first, append=len(pair))
    mean = np.add.reduceat(found.weight, first) / count
    share = np.repeat(np.clip((mean - SLIGHT) / (1 - 2 * SLIGHT), 0, 1), count)
    start = np.where(begins, -before, (c + np.roll(c, 1)) / 2)
    stop = np.where(last, h + after, (c + np.roll(c, -1)) / 2)
    taken = np.stack([np.where(begins, 0.5 + before / h, 0), np.where(last, 0.5 + after / h, 0)])
    lines = Interval(here.x, here.y, here.vertical, h, c, start, stop, found.behind, share * h)
    return lines, pair, taken * share * (here.pixel >= 0)


def _is_marked(marks: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """For each number, bool: it is among the marks.

    All are small. (np.isin first looks for their range, which takes long.)
    """
    table = np.zeros(1 + max(marks.max(initial=0), numbers.max(initial=0)), bool)
    table[marks] = True
    return table.take(numbers)


def samples_beside(
    interval: Interval, pieces: int, pixel: np.ndarray, order: np.ndarray, share: np.ndarray
) -> Extra:
    """The samples of intervals, each part of which is cut into pieces.

    Args:
        pixel, order, share: (2, N), of the samples a and b.
    """
    x, y, weight, in_b, behind = nodes(interval, pieces)
    pixel, order = np.where(in_b, *pixel[::-1]), np.where(behind, *order[::-1])
    weight = weight * np.where(in_b, *share[::-1])
    kept = np.flatnonzero((weight > 0) & (pixel >= 0))
    columns = (column.ravel().take(kept) for column in (x, y, pixel, weight, order))
    x, y, pixel, weight, order = columns
    return Extra(x, y, pixel, weight, order)


def nodes(interval: Interval, pieces: int) -> tuple[np.ndarray, ...]:
    """The samples of intervals, each of shape (4 pieces, intervals).

    The first quarter lies between the edge and the cells' border, the next two beyond both on the
    side of the square root, the last on the other.

    Args:
        pieces: how many each of the three parts is cut into; on the side of the square root, at
            equal steps of it.

    Returns:
        Image position x, y, weight, bool: in b's cell, and bool: behind the edge.
    """
    c, rooted = interval.edge, interval.behind
    border = np.minimum(np.maximum(interval.length / 2, interval.start), interval.stop)
    between, cut = np.abs(c - border), c < border
    facing = cut == rooted
    before, after = c - interval.start, interval.stop - c

    # Where the parts beyond both begin and end, as distances from the edge
    low, start = np.where(facing, between, 0), np.where(facing, 0, between)
    high = np.maximum(np.where(rooted, after, before), low)
    stop = np.maximum(np.where(rooted, before, after), start)
    middle = ((np.arange(pieces) + 0.5) / pieces)[:, None]
    u, v = np.sqrt(low), np.sqrt(high)
    width = (v - u) / pieces
    mean, spread = u + (v - u) * middle, width * (3**-0.5 / 2)
    first, second = mean - spread, mean + spread
    smooth, near = start + (stop - start) * middle, np.where(facing, middle * middle, middle)
    distance = between * near, first * first, second * second, smooth
    part = np.where(facing, 2 * middle, 1)
    rest = (stop - start) * np.ones_like(middle) / pieces
    weight = between * part / pieces, width * first, width * second, rest

    behind, in_b = (np.repeat([where, rooted, rooted, ~rooted], pieces, 0) for where in (cut, ~cut))
    along = np.where(behind, c + np.concatenate(distance), c - np.concatenate(distance))
    x, y = interval.x + along * ~interval.vertical, interval.y + along * interval.vertical
    return x, y, np.concatenate(weight) * interval.weight, in_b, behind
