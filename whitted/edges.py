"""The bookkeeping of edges on a grid of samples: which samples are neighbours across one, and what it moves where.

All in NumPy, on the few samples that are concerned, and in an order that does not depend on threads. A band's pixels
are numbered row by row; image positions and lengths are in pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property, lru_cache
from typing import Any, TypeVar

import numpy as np

Table = TypeVar("Table")


def _columns(table: Any) -> list:
    return [getattr(table, field.name) for field in fields(table)]


def take(table: Table, which: np.ndarray) -> Table:
    """Some rows of a dataclass of arrays, by number."""
    return type(table)(*(take(v, which) if is_dataclass(v) else v.take(which, 0) for v in _columns(table)))


def joined(tables: Sequence[Table]) -> Table:
    """The rows of several dataclasses of arrays."""
    columns = zip(*(_columns(table) for table in tables), strict=True)
    return type(tables[0])(*(joined(c) if is_dataclass(c[0]) else np.concatenate(c) for c in columns))


@dataclass(frozen=True)
class Pairs:
    """Neighbouring samples with different labels; `a` is to the left of `b`, or above it."""

    x: np.ndarray  # image position of a
    y: np.ndarray
    vertical: np.ndarray  # bool
    length: np.ndarray  # from a to b, in pixels
    sample: np.ndarray  # (N, 2): numbers of a and b
    label: np.ndarray  # (N, 2)
    color: np.ndarray  # (N, 2, 3)
    pixel: np.ndarray  # (N, 2): the pixels that a and b belong to, -1 where those are not to be corrected
    alone: np.ndarray  # (N, 2) bool: no edge is on the other side of a, of b

    def __len__(self) -> int:
        return len(self.x)


def dense_pairs(labels: np.ndarray, colors: np.ndarray, side: int, first_row: int) -> Pairs:
    """The pairs of a band with a margin of one pixel, whose labels lie row by row of samples; samples are numbered so."""
    pixels, xs, ys = _grid(labels.shape, side)
    parts = []
    for vertical, step in ((False, 1), (True, labels.shape[1])):
        flips = labels.ravel()[step:] != labels.ravel()[:-step]
        a = np.flatnonzero(flips)
        pixel = np.stack([pixels.take(a), pixels.take(a + step)], 1)
        # Not those in the margin, among which are those from the end of a row to the next one's start
        kept = np.flatnonzero(pixel.max(1) >= 0)
        a, pixel = a.take(kept), pixel.take(kept, 0)
        sample = np.stack([a, a + step], 1)
        alone = ~np.stack([flips.take(a - step, mode="clip"), flips.take(a + step, mode="clip")], 1)
        length, label = np.full(len(a), 1 / side), labels.ravel().take(sample)
        x, y = xs.take(a), ys.take(a) + first_row
        parts.append(Pairs(x, y, np.full(len(a), vertical), length, sample, label, colors.take(sample, 0), pixel, alone))
    return joined(parts)


@lru_cache(maxsize=2)
def _grid(shape: tuple[int, int], side: int) -> tuple[np.ndarray, ...]:
    """For each sample of a band with a margin its pixel, -1 in the margin, and its position."""
    rows, columns = shape[0] // side - 2, shape[1] // side - 2
    j, i = np.divmod(np.arange(shape[0] * shape[1]), shape[1])
    x, y = i // side - 1, j // side - 1
    pixel = np.where((x >= 0) & (y >= 0) & (x < columns) & (y < rows), y * columns + x, -1)
    return pixel.astype(np.int32), (i + 0.5) / side - 1, (j + 0.5) / side - 1


def contrasting(pairs: Pairs, least: float) -> Pairs:
    """The pairs whose samples differ by more than a part of the brighter one."""
    a, b = pairs.color[:, 0], pairs.color[:, 1]
    flat = np.abs(a - b).max(1) < least * np.maximum(a, b).max(1)
    return take(pairs, np.flatnonzero(~flat))


def label_counts(labels: np.ndarray, colors: np.ndarray, side: int, pixels: np.ndarray, least: float) -> np.ndarray:
    """How many labels the samples of a pixel and its neighbours' nearest have; 1 where their contrast is too small."""
    stride = labels.shape[1]
    columns = stride // side - 2
    across, inner = np.meshgrid(np.arange(-1, side + 1), np.arange(side))
    window = np.unique(np.concatenate([inner * stride + across, across * stride + inner]))
    start = (pixels // columns + 1) * side * stride + (pixels % columns + 1) * side
    near = start[:, None] + window
    around = np.sort(labels.ravel()[near], 1)
    counts = 1 + (around[:, 1:] != around[:, :-1]).sum(1)
    several = np.flatnonzero(counts > 2)
    seen = colors.take(near[several], 0)
    high = seen.max(1)
    counts[several[(high - seen.min(1)).max(1) < least * high.max(1)]] = 1
    return counts


def fine_positions(pixels: np.ndarray, columns: int, side: int, first_row: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions of side * side samples in each pixel and of a ring of samples around it: shape (N, side + 2, side + 2)."""
    offset = (np.arange(-1, side + 1) + 0.5) / side
    x = (pixels % columns)[:, None, None] + offset + 0 * offset[:, None]
    y = (pixels // columns + first_row)[:, None, None] + offset[:, None] + 0 * offset
    return x, y


def fine_pairs(labels: np.ndarray, colors: np.ndarray, x: np.ndarray, y: np.ndarray, pixels: np.ndarray, first: int) -> Pairs:
    """The pairs of pixels with `fine_positions`, whose samples are numbered from `first` on."""
    side = labels.shape[1] - 2
    parts = []
    for vertical in (False, True):
        turned = labels.transpose(0, 2, 1) if vertical else labels
        flips = turned[:, 1:-1, 1:] != turned[:, 1:-1, :-1]
        n, line, k = np.nonzero(flips)
        alone = np.stack([~flips[n, line, np.maximum(k - 1, 0)], ~flips[n, line, np.minimum(k + 1, side)]], 1)
        pixel = np.stack([np.where(k > 0, pixels[n], -1), np.where(k < side, pixels[n], -1)], 1)
        j, i = (k, line + 1) if vertical else (line + 1, k)
        at = (n * (side + 2) + j) * (side + 2) + i
        sample = at[:, None] + np.array([0, side + 2 if vertical else 1])
        x_a, y_a, length, label = x.ravel()[at], y.ravel()[at], np.full(len(n), 1 / side), labels.ravel()[sample]
        color = colors.take(sample, 0)
        parts.append(Pairs(x_a, y_a, np.full(len(n), vertical), length, first + sample, label, color, pixel, alone))
    return joined(parts)


@dataclass(frozen=True)
class Crossings:
    """Edges that cross pairs, in the order of the pairs and of the way from a to b."""

    pairs: Pairs  # each crossing's pair, as often as it has crossings
    pair: np.ndarray  # the pair's number
    along: np.ndarray  # distance from a
    slope: np.ndarray  # of the level function from a to b, per pixel
    across: np.ndarray  # the same in the image's other direction
    jump: np.ndarray  # (N, 3): radiance before the edge less that behind it
    singular: np.ndarray  # bool: near the edge radiance changes like the square root of the distance

    def __len__(self) -> int:
        return len(self.pair)

    @cached_property
    def weight(self) -> np.ndarray:
        """The share of the edge that pairs of this direction account for; those of the other have the rest."""
        # Scaled, as fourth powers leave the range of single precision
        u, v = np.abs(self.slope), np.abs(self.across)
        largest = np.maximum(u, v)
        u, v = (u / largest) ** 4, (v / largest) ** 4
        return u / (u + v)

    @cached_property
    def tilt(self) -> np.ndarray:
        """How far the edge moves along the pair from one line of samples to the next, halved."""
        return np.clip(np.abs(self.across / self.slope), 1e-6, 1) * self.pairs.length / 2

    def change(self) -> np.ndarray:
        """(N, 2, 3): how the pixels of a and of b change with the level function at the edge."""
        a = np.clip(0.5 - (self.along - self.pairs.length / 2) / (2 * self.tilt), 0, 1)
        area = -self.pairs.length * self.weight / self.slope
        share = np.stack([a, 1 - a], 1) * (area[:, None] * (self.pairs.pixel >= 0))
        return share[:, :, None] * self.jump[:, None]

    def moved(self, stretched: np.ndarray) -> np.ndarray:
        """(N, 2, 3): what the edge adds to the pixels of a and of b because it is not midway, and at an angle to the pair.

        Args:
            stretched: bool, the first of the two is left to `quadrature.Stretch`.
        """
        past, r = self.along - self.pairs.length / 2, self.tilt
        straight = np.minimum(past, 0)
        a = np.where(np.abs(past) < r, -((r - past) ** 2) / (4 * r), straight)
        both = np.stack([a - np.where(stretched, straight, 0), np.where(stretched, straight, past) - a], 1)
        return (both * (self.weight * self.pairs.length)[:, None])[:, :, None] * self.jump[:, None]

    def stretched(self) -> np.ndarray:
        """Whether a pair has a singular edge, for each of its crossings."""
        first = self._first
        return np.repeat(np.logical_or.reduceat(self.singular, first), np.diff(first, append=len(self)))

    @cached_property
    def _first(self) -> np.ndarray:
        """The first crossing of each pair."""
        return np.flatnonzero(np.diff(self.pair, prepend=-1))

    def stretches(self) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """The fields of `quadrature.Stretch`, and (N, 2) what they take away from the samples a and b, as parts of those.

        A stretch goes halfway to the next crossing, or to the end of a sample's cell.
        """
        pairs, c, h = self.pairs, self.along, self.pairs.length
        begins = np.zeros(len(self), bool)
        begins[self._first] = True
        ends = np.roll(begins, -1)
        # Where another edge is on the other side of a sample, its cell ends at the sample
        before, behind = np.where(pairs.alone[:, 0], h / 2, 0), np.where(pairs.alone[:, 1], h / 2, 0)
        # All crossings of a pair share one weight, so that its samples are taken away as a whole
        count = np.diff(self._first, append=len(self))
        share = np.repeat(np.add.reduceat(self.weight, self._first) / count, count)
        fields = {
            "x": pairs.x,
            "y": pairs.y,
            "vertical": pairs.vertical,
            "length": h,
            "edge": c,
            "start": np.where(begins, -before, (c + np.roll(c, 1)) / 2),
            "stop": np.where(ends, h + behind, (c + np.roll(c, -1)) / 2),
            "rooted": self.slope > 0,
            "weight_a": np.where(pairs.pixel[:, 0] >= 0, share * h, 0),
            "weight_b": np.where(pairs.pixel[:, 1] >= 0, share * h, 0),
        }
        taken = np.stack([np.where(begins, 0.5 + before / h, 0), np.where(ends, 0.5 + behind / h, 0)], 1)
        return fields, taken * share[:, None] * (pairs.pixel >= 0)


def positions(pairs: Pairs, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Image positions at distances from a."""
    return pairs.x + np.where(pairs.vertical, 0, along), pairs.y + np.where(pairs.vertical, along, 0)


def deposit(image: np.ndarray, pixel: np.ndarray, value: np.ndarray) -> None:
    """Add values, shape (..., channels), to pixels, (...), of an image, (pixels, channels), in order; pixel -1 takes none."""
    channels = image.shape[1]
    kept = np.flatnonzero(pixel >= 0)
    index = pixel.take(kept)[:, None] * channels + np.arange(channels)
    values = value.reshape(-1, channels).take(kept, 0).astype(image.dtype, copy=False)
    np.add.at(image.reshape(-1), index.ravel(), values.ravel())
