"""Samples that integrate radiance between two neighbours with an edge in between, in place of the
two.

On one side of a silhouette, where the sphere is, radiance is a + b sqrt(distance) + c distance +
..., because so is the normal, and its derivative a / sqrt(distance) + b + ...; the same holds where
refraction ends in total reflection. There two of Gauss's points in sqrt(distance) integrate
radiance up to the term in distance, and its derivative as far. They also do better than samples
where a surface, met at a small angle, runs off into the distance between the two. On the other side
there is one sample, in the middle. The border between the two neighbours' cells cuts one of the
sides; the part between it and the edge has a sample of its own. Where several edges are between the
neighbours, as where curved mirrors touch, what lies between two of them is small and bright, and
each part is cut into pieces with as many samples.
"""

from dataclasses import dataclass

import numpy as np

from .pairs import Crossings, Pairs
from .settings import SLIGHT
from .tables import rows_of


@dataclass(frozen=True)
class Interval:
    """The line through two neighbours a and b, or the part of it that is nearest to one of its
    edges; a table.

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
    weight: np.ndarray  # in the pixel of a or that of b, for a unit of length


@dataclass(frozen=True)
class Extra:
    """Samples in pixels that are sampled anew, and beside edges; a table."""

    x: np.ndarray
    y: np.ndarray
    pixel: np.ndarray
    weight: np.ndarray  # what the sample counts for in its pixel
    beside: np.ndarray  # bool: it is beside an edge
    order: np.ndarray  # of `walk_order`


def intervals_beside(
    crossings: Crossings, pairs: Pairs, ends: np.ndarray
) -> tuple[Interval, np.ndarray, np.ndarray]:
    """The lines to sample anew, which are those of pairs with a singular edge.

    An interval goes halfway to the next crossing, or to the end of a sample's cell.

    Args:
        ends: those of all pairs with a singular edge (`Pairs.ends`).

    Returns:
        The intervals, each one's pair, and (2, N) what they take away from the samples a and b, as
        parts of those.
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
    # Where the pair on the other side of a sample has a singular edge as well, each takes half of
    # the sample's cell
    a, b = pairs.ends(pair)
    before = np.where(_is_marked(ends[1], a), 0, h / 2)
    after = np.where(_is_marked(ends[0], b), 0, h / 2)
    # All crossings of a pair share one weight, so that its samples are taken away as a whole. Pairs
    # along an edge take none and those across it all: a part of a sample that is close to the edge
    # would spoil the sum
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
    """Whether each number is among the marks, all of them small (np.isin first looks for their
    range, which takes long).
    """
    table = np.zeros(1 + max(marks.max(initial=0), numbers.max(initial=0)), bool)
    table[marks] = True
    return table.take(numbers)


def samples_beside(interval: Interval, pieces: int, pixel: np.ndarray, order: np.ndarray) -> Extra:
    """The samples of intervals in pieces.

    Args:
        pixel, order: (2, N), of the samples a and b.
    """
    x, y, weight, in_b, behind = nodes(interval, pieces)
    pixel, order = np.where(in_b, *pixel[::-1]), np.where(behind, *order[::-1])
    kept = np.flatnonzero((weight > 0) & (pixel >= 0))
    x, y, pixel, weight, order = (
        column.ravel().take(kept) for column in (x, y, pixel, weight, order)
    )
    return Extra(x, y, pixel, weight, np.ones(len(x), bool), order)


def nodes(interval: Interval, pieces: int) -> tuple[np.ndarray, ...]:
    """The samples of intervals, each of shape (4 pieces, intervals).

    The first quarter lies between the edge and the cells' border, the next two beyond both on the
    side of the square root, the last on the other.

    Args:
        pieces: into which each of the three parts is cut, those on the side of the square root at
            equal steps of it.

    Returns:
        Image position x, y, weight, and whether the samples are in b's cell and behind the edge.
    """
    c, rooted = interval.edge, interval.behind
    border = np.minimum(np.maximum(interval.length / 2, interval.start), interval.stop)
    between, cut = np.abs(c - border), c < border
    facing = cut == rooted
    before, after = c - interval.start, interval.stop - c

    # From where to where the parts beyond both are, as distances from the edge
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
