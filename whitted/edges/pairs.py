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
    # (2, N): the pixels that a and b belong to; below 0 where those are not to be corrected
    pixel: np.ndarray

    def __len__(self) -> int:
        return len(self.x)

    def ends(self, which: np.ndarray) -> np.ndarray:
        """(2, N): numbers that tell each sample and the direction of its pair, for a and for b."""
        return self.sample.take(which, 1) * 2 + self.vertical.take(which)


@dataclass(frozen=True)
class Moves:
    """What edges move between the pixels of pairs."""

    pixel: np.ndarray  # (2, N)
    moved: np.ndarray  # (2, N), in units of the jump
    jump: np.ndarray  # (3, N)
    before: np.ndarray  # (3, N): radiance right before the edge


@dataclass(frozen=True)
class Crossings:
    """Edges that cross pairs."""

    pair: np.ndarray  # the pair's number
    along: np.ndarray  # distance from a
    jump: np.ndarray  # (3, N): radiance before the edge less that behind it
    # (2, N): how much more of the jump the cells of a and of b get as the level function grows
    change: np.ndarray
    weight: np.ndarray  # the share of the edge that pairs of this direction account for
    # bool: radiance near the edge changes like the square root of the distance, or faster
    singular: np.ndarray
    behind: np.ndarray  # bool: it does so behind the edge, not before it

    def __len__(self) -> int:
        return len(self.pair)


def pairs_of(samples: Samples, a: np.ndarray, b: np.ndarray, ends: np.ndarray) -> Pairs:
    """Neighbours with different labels, those across the same edge together."""
    label = samples.labels.ravel().take(np.stack([a, b]))
    walks = walk_order(label, samples.few_alike)
    order = np.argsort(walks[0] + walks[1], kind="stable")
    a, b = a.take(order), b.take(order)
    return Pairs(
        x=samples.x.take(a),
        y=samples.heights(a),
        vertical=b - a > 1,
        length=np.full(len(a), 1 / samples.side),
        sample=samples.counted(np.stack([a, b])) + samples.first,
        label=label.take(order, 1),
        order=walks.take(order, 1),
        pixel=ends.take(order, 1),
    )


def walk_order(labels: np.ndarray, few_alike: bool) -> np.ndarray:
    """An order that puts equal trees of rays together.

    It has sixteen bits, which NumPy sorts in linear time.

    Args:
        few_alike: few of the trees are equal, as among many spheres. Then all keep their places:
            what is side by side comes near the same spheres.
    """
    return np.zeros(labels.shape, np.uint16) if few_alike else labels.astype(np.uint16)


def interleaved(order: np.ndarray) -> np.ndarray:
    """Lanes with their packets dealt out in turn.

    Neighbouring lanes do like work; dealt out, threads get equal shares of it.
    """
    whole = len(order) // (SHARES * PACKET) * SHARES * PACKET
    dealt = order[:whole].reshape(-1, SHARES, PACKET).swapaxes(0, 1).ravel()
    return np.concatenate([dealt, order[whole:]])
