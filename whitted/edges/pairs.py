"""Pairs of neighbouring samples with an edge in between, and the edges that were found there."""

from dataclasses import dataclass

import numpy as np

from ..core.host import PACKET
from .grid import Samples
from .settings import SHARES


@dataclass(frozen=True)
class Pairs:
    """Neighbouring samples with different labels; `a` is to the left of `b`, or above it."""

    x: np.ndarray  # image position of a
    y: np.ndarray
    vertical: np.ndarray  # bool
    length: np.ndarray  # from a to b, in pixels
    sample: np.ndarray  # (2, N): numbers of a and b
    label: np.ndarray  # (2, N)
    order: np.ndarray  # (2, N), of `walk_order`
    pixel: (
        np.ndarray
    )  # (2, N): the pixels that a and b belong to, below 0 where those are not to be corrected

    def __len__(self) -> int:
        return len(self.x)

    def ends(self, which: np.ndarray) -> np.ndarray:
        """(2, N): one number for the sample a of some pairs and their direction, and one for b's."""
        return self.sample.take(which, 1) * 2 + self.vertical.take(which)


@dataclass(frozen=True)
class Moves:
    """What edges move between the pixels of pairs."""

    pixel: np.ndarray  # (2, N)
    moved: np.ndarray  # (2, N), in units of the jump
    jump: np.ndarray  # (3, N)


@dataclass(frozen=True)
class Crossings:
    """Edges that cross pairs."""

    pair: np.ndarray  # the pair's number
    along: np.ndarray  # distance from a
    jump: np.ndarray  # (3, N): radiance before the edge less that behind it
    change: (
        np.ndarray
    )  # (2, N): how much more of it the cells of a and of b have as the level function grows
    weight: np.ndarray  # the share of the edge that pairs of this direction account for
    singular: (
        np.ndarray
    )  # bool: radiance near the edge changes like the square root of the distance, or faster
    behind: np.ndarray  # bool: it does so behind the edge, not before it

    def __len__(self) -> int:
        return len(self.pair)


def pairs_of(samples: Samples, a: np.ndarray, b: np.ndarray, ends: np.ndarray) -> Pairs:
    """Neighbours with different labels, those across the same edge together."""
    label = samples.labels.ravel().take(np.stack([a, b]))
    walks = walk_order(label)
    order = np.argsort(walks[0] + walks[1], kind="stable")
    a, b = a.take(order), b.take(order)
    return Pairs(
        x=samples.x.take(a),
        y=samples.y.take(a) + samples.top,
        vertical=b - a > 1,
        length=np.full(len(a), 1 / samples.side),
        sample=samples.counted(np.stack([a, b])) + samples.first,
        label=label.take(order, 1),
        order=walks.take(order, 1),
        pixel=ends.take(order, 1),
    )


def walk_order(labels: np.ndarray) -> np.ndarray:
    """An order in which equal trees of rays come together. Sixteen bits, which NumPy sorts in
    linear time.
    """
    return labels.astype(np.uint16)


def interleaved(order: np.ndarray) -> np.ndarray:
    """Lanes of which neighbours do like work, with packets dealt out in turn: threads get equal
    shares of all work.
    """
    whole = len(order) // (SHARES * PACKET) * SHARES * PACKET
    dealt = order[:whole].reshape(-1, SHARES, PACKET).swapaxes(0, 1).ravel()
    return np.concatenate([dealt, order[whole:]])
