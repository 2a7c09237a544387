"""The bookkeeping of edges on a grid of samples: which samples are neighbours across one, and what it moves where.

All in NumPy, on the few samples that are concerned, and in an order that does not depend on threads. A band's pixels
are numbered row by row; image positions and lengths are in pixels.
"""

from dataclasses import dataclass

import numpy as np



@dataclass(frozen=True)
class Pairs:
    """Neighbouring samples with different labels; `a` is to the left of `b`, or above it."""

    x: np.ndarray  # image position of a
    y: np.ndarray
    vertical: np.ndarray  # bool
    length: np.ndarray  # from a to b, in pixels
    pixel: np.ndarray  # (N, 2): the pixels that a and b belong to, -1 where those are not to be corrected
    alone: np.ndarray  # (N, 2) bool: no edge is on the other side of a, of b
    label: np.ndarray  # (N, 2): of a and of b

    def __len__(self) -> int:
        return len(self.x)

    def take(self, which) -> "Pairs":
        return Pairs(*(value[which] for value in vars(self).values()))

    @staticmethod
    def joined(parts: list["Pairs"]) -> "Pairs":
        return Pairs(*(np.concatenate(values) for values in zip(*(vars(part).values() for part in parts), strict=True)))


def dense_pairs(labels: np.ndarray, side: int, first_row: int) -> Pairs:
    """The pairs of a band with a margin of one pixel, whose labels lie row by row of samples."""
    rows, columns = (length // side - 2 for length in labels.shape)
    across, down = labels[:, 1:] != labels[:, :-1], labels[1:] != labels[:-1]
    parts = []
    for vertical, flips in ((False, across), (True, down.T)):
        # Along a line of samples: the pair k is of the samples k and k + 1
        line, k = np.nonzero(flips[side : -side or None, side - 1 : (1 - side) or None])
        line, k = line + side, k + side - 1
        alone = np.stack([~flips[line, np.maximum(k - 1, 0)], ~flips[line, np.minimum(k + 1, flips.shape[1] - 1)]], 1)
        i, j = (line, k) if vertical else (k, line)
        other = (i, j + 1) if vertical else (i + 1, j)
        pixel = np.stack([_pixel(*at, side, rows, columns) for at in ((i, j), other)], 1)
        x, y = (i + 0.5) / side - 1, (j + 0.5) / side - 1 + first_row
        label = np.stack([labels[j, i], labels[other[1], other[0]]], 1)
        parts.append(Pairs(x, y, np.full(len(x), vertical), np.full(len(x), 1 / side), pixel, alone, label))
    return Pairs.joined(parts)


def _pixel(i: np.ndarray, j: np.ndarray, side: int, rows: int, columns: int) -> np.ndarray:
    x, y = i // side - 1, j // side - 1
    return np.where((x >= 0) & (y >= 0) & (x < columns) & (y < rows), y * columns + x, -1)


def busy_pixels(labels: np.ndarray, side: int, candidates: np.ndarray) -> np.ndarray:
    """Those of the candidate pixels whose samples and their neighbours have three labels or more: edges meet there."""
    columns = labels.shape[1] // side - 2
    window = np.arange(-1, side + 1)
    y, x = (candidates // columns + 1) * side, (candidates % columns + 1) * side
    near = labels[y[:, None, None] + window[:, None], x[:, None, None] + window].reshape(len(candidates), -1)
    first = near[:, :1]
    second = np.where(near != first, near, 0).max(1, keepdims=True, initial=0)
    return candidates[((near != first) & (near != second)).any(1)]


def fine_positions(pixels: np.ndarray, columns: int, side: int, first_row: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions of side * side samples in each pixel and of a ring of samples around it: shape (N, side + 2, side + 2)."""
    offset = (np.arange(-1, side + 1) + 0.5) / side
    x = (pixels % columns)[:, None, None] + offset + 0 * offset[:, None]
    y = (pixels // columns + first_row)[:, None, None] + offset[:, None] + 0 * offset
    return x, y


def fine_pairs(labels: np.ndarray, x: np.ndarray, y: np.ndarray, pixels: np.ndarray) -> Pairs:
    """The pairs of pixels with `fine_positions`."""
    side = labels.shape[1] - 2
    parts = []
    for vertical in (False, True):
        turned = labels.transpose(0, 2, 1) if vertical else labels
        flips = turned[:, 1:-1, 1:] != turned[:, 1:-1, :-1]
        n, line, k = np.nonzero(flips)
        alone = np.stack([~flips[n, line, np.maximum(k - 1, 0)], ~flips[n, line, np.minimum(k + 1, side)]], 1)
        pixel = np.stack([np.where(k > 0, pixels[n], -1), np.where(k < side, pixels[n], -1)], 1)
        at = (n, k, line + 1) if vertical else (n, line + 1, k)
        label = np.stack([turned[n, line + 1, k], turned[n, line + 1, k + 1]], 1)
        parts.append(Pairs(x[at], y[at], np.full(len(n), vertical), np.full(len(n), 1 / side), pixel, alone, label))
    return Pairs.joined(parts)


@dataclass(frozen=True)
class Crossings:
    """Edges that cross pairs, in the order of the pairs and of the way from a to b."""

    pairs: Pairs  # each crossing's pair, as often as it has crossings
    pair: np.ndarray  # the pair's number
    along: np.ndarray  # distance from a
    slope: np.ndarray  # of the level function from a to b, per pixel
    across: np.ndarray  # the same in the image's other direction
    jump: np.ndarray  # (N, 3): radiance before the edge less that behind it

    def take(self, which: np.ndarray) -> "Crossings":
        return Crossings(*(value.take(which) if isinstance(value, Pairs) else value[which] for value in vars(self).values()))

    @staticmethod
    def joined(parts: list["Crossings"]) -> "Crossings":
        numbers = list(zip(*(list(vars(part).values())[1:] for part in parts), strict=True))
        return Crossings(Pairs.joined([part.pairs for part in parts]), *(np.concatenate(values) for values in numbers))

    @property
    def weight(self) -> np.ndarray:
        """The share of the edge that pairs of this direction account for; those of the other have the rest."""
        u, v = self.slope**4, self.across**4
        return u / np.where(u + v > 0, u + v, 1)

    @property
    def tilt(self) -> np.ndarray:
        """How far the edge moves along the pair from one line of samples to the next, halved."""
        return np.clip(np.abs(self.across / self.slope), 1e-6, 1) * self.pairs.length / 2

    @property
    def share(self) -> np.ndarray:
        """(N, 2): the parts of the edge's piece in the pixels of a and of b."""
        a = np.clip(0.5 - (self.along - self.pairs.length / 2) / (2 * self.tilt), 0, 1)
        return np.stack([a, 1 - a], 1)

    @property
    def change(self) -> np.ndarray:
        """(N, 2, 3): how the pixels of a and of b change with the level function at the edge."""
        area = -self.pairs.length * self.weight / self.slope
        return (self.share * area[:, None] * (self.pairs.pixel >= 0))[:, :, None] * self.jump[:, None]


def positions(pairs: Pairs, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Image positions at distances from a: shape (N,) or (N, M)."""
    vertical, x, y = (value.reshape(-1, *(1,) * (along.ndim - 1)) for value in (pairs.vertical, pairs.x, pairs.y))
    return x + np.where(vertical, 0, along), y + np.where(vertical, along, 0)


def nodes(found: Crossings) -> tuple[np.ndarray, np.ndarray]:
    """Samples that stand in for the two of a pair.

    On either side of an edge radiance is a + b sqrt(distance) + ...: near a silhouette so is the normal. Gauss's points
    in sqrt(distance) integrate this and its derivative; the two samples of the pair are taken away.

    Returns:
        Distances from a, shape (N, 7), and weights as parts of a pixel for the pixels of a and of b, (N, 7, 2).
    """
    pairs, c, h = found.pairs, found.along, found.pairs.length
    first = np.diff(found.pair, prepend=-1) != 0
    last = np.roll(first, -1)
    # Halfway to the next crossing; without one, the end of the sample's cell, or the sample itself
    start = np.where(first, np.where(pairs.alone[:, 0], -h / 2, 0), (c + np.roll(c, 1)) / 2)
    stop = np.where(last, np.where(pairs.alone[:, 1], 1.5 * h, h), (c + np.roll(c, -1)) / 2)
    # The border between the cells of a and b cuts one of the two sides in a near and a far part
    border = np.clip(h / 2, start, stop)
    near, left = np.abs(c - border), c < border
    along, weight = [c + np.where(left, near, -near) / 4], [(near, c + np.where(left, near, -near) / 2 > h / 2)]
    for sign, end in ((-1, start), (1, stop)):
        inner = np.sqrt(np.where(left == (sign == 1), near, 0))
        outer = np.sqrt(np.maximum(np.abs(end - c), inner**2))
        where = (c + sign * (inner**2 + outer**2) / 2) > h / 2
        for offset in (-1, 1):
            root = (inner + outer) / 2 + offset * (outer - inner) / (2 * np.sqrt(3))
            along.append(c + sign * root**2)
            weight.append(((outer - inner) * root, where))
    own = np.where(pairs.alone, h[:, None], h[:, None] / 2)
    along += [np.zeros_like(c), h]
    weight += [(-own[:, 0] * first, np.zeros_like(first)), (-own[:, 1] * last, np.ones_like(first))]
    # All crossings of a pair share one weight, so that its samples are taken away as a whole
    edge = np.flatnonzero(first)
    count = np.diff(edge, append=len(c))
    shared = np.repeat(np.add.reduceat(found.weight, edge) / count, count)
    scale = (shared * h)[:, None]
    amount, in_b = np.stack([w for w, _ in weight], 1) * scale, np.stack([b for _, b in weight], 1)
    both = np.stack([np.where(in_b, 0, amount), np.where(in_b, amount, 0)], 2)
    return np.stack(along, 1), both * (pairs.pixel >= 0)[:, None, :]


def tilted(found: Crossings) -> np.ndarray:
    """(N, 2): what a unit jump moves between the two pixels because the edge is not at right angles to the pair."""
    h, r = found.pairs.length, found.tilt
    past = found.along - h / 2
    inside = np.abs(past) < r
    lower = np.where(inside, -((r - past) ** 2) / (4 * r), np.minimum(past, 0)) - np.minimum(past, 0)
    move = lower * found.weight * h
    return np.stack([move, -move], 1)


def deposit(image: np.ndarray, pixel: np.ndarray, value: np.ndarray) -> None:
    """Add values, shape (N, 2, 3), to pixels, (N, 2), of an image, (pixels, 3), in a fixed order; pixel -1 takes none."""
    kept = pixel.ravel() >= 0
    pixel, value = pixel.ravel()[kept], value.reshape(-1, 3)[kept]
    if len(pixel):
        order = np.argsort(pixel, kind="stable")
        first = np.flatnonzero(np.diff(pixel[order], prepend=-1))
        image[pixel[order[first]]] += np.add.reduceat(value[order], first, axis=0)
