"""What chains of rays have met, kept so that later walks need not search for it again."""

from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
from drjit.llvm import ad

from ..core.arrays import Array, Precision
from ..core.ray import NONE
from ..shapes.sets import Hit
from .node import Node, Visit

# Nodes of a record, at most: each takes 12 bytes, or 16 in double precision
MOST_NODES = 1 << 25

# From a node to its hit
Hits = Callable[[Node], Hit]


@dataclass(frozen=True)
class Record:
    """The hits of samples, one node of their chains after the other."""

    t: Array
    index: Array  # UInt32
    bits: Array  # UInt32: the ray was inside; then for each light, something is in between
    samples: Array  # UInt32, their number

    @staticmethod
    def of(precision: Precision, samples: int, nodes: int) -> "Record":
        """A record in which no node has met anything.

        Args:
            nodes: of each sample's chain, at most.
        """
        t, bits = (dr.empty(kind, samples * nodes) for kind in (precision.real, ad.UInt32))
        index = dr.full(ad.UInt32, NONE, samples * nodes)
        dr.eval(index)
        return Record(t, index, bits, dr.opaque(ad.UInt32, samples))

    def write(self, sample: Array, seen: Visit) -> None:
        """Keep a node's hit, once the light of its surface is known.

        Args:
            sample: the number of the node's sample.
        """
        bits = dr.select(seen.at.hit.inside, ad.UInt32(1), 0)
        for (k, _), light in seen.at.lights.items():
            bits |= dr.select(light.blocked, ad.UInt32(2 << k), 0)
        place = self._place(sample, seen.node)
        dr.scatter(self.t, seen.at.hit.t, place)
        dr.scatter(self.index, seen.at.hit.index, place)
        dr.scatter(self.bits, bits, place)

    def hits(self, sample: Array) -> Hits:
        """What finds the hits of nodes of some samples."""

        def hit(node: Node) -> Hit:
            place = self._place(sample, node)
            t, index, bits = (dr.gather(type(x), x, place) for x in (self.t, self.index, self.bits))
            return Hit(t, index, (bits & 1) != 0, bits >> 1)

        return hit

    def _place(self, sample: Array, node: Node) -> Array:
        return (node.depth - 1) * self.samples + sample


def hit_of(node: Node, hits: Hits | None) -> Hit | None:
    """A node's hit, where it is known."""
    return None if hits is None else hits(node)
