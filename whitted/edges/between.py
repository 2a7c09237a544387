"""The edge between two samples that are close to each other, told from the two samples alone.

No root is searched, and nothing is traced beside the edge. Its place is that of a level function
that is linear from one sample to the other. Its jump is the difference of the light that comes up
through the node where the two trees differ. That includes what changes smoothly between the
samples below that node, and what other edges change there: all of it is taken to move with the
edge. The error is of the order of the samples' distance, and falls with it.

Source: Y. Belhe et al. (2025) snap edges to segments in the same way.
"""

from dataclasses import dataclass

import drjit as dr

from ..core.arrays import Array
from ..tracing.node import visit
from ..tracing.record import Hits
from .events import classify, has_rooted_outline, reaching
from .locate import end_levels
from .motion import Edge
from .paths import bright_below, strongest_difference
from .settings import FADING_BETWEEN
from .slopes import Line, Shot, areas, slopes_of


@dataclass(frozen=True)
class Between:
    """An edge between a and b."""

    x: Array  # image position of the edge
    y: Array
    change: Array  # Array2f: what the cells of a and b gain of the jump as the level function grows
    jump: Array  # Array3f: radiance of a less that of b, as far as it moves with the edge
    # How much of b's cell (of a's, if negative) lies between the edge and the sample, where the
    # jump includes what changes like the square root of the distance from the edge
    rooted: Array
    edge: Edge


def edge_between(
    shot: Shot, line: Line, least: Array, hits: tuple[Hits | None, Hits | None]
) -> Between:
    """The edge between the samples at the two ends of a short line.

    Args:
        least: the least weight of the nodes whose light counts.
        hits: of the nodes of each sample, where they are known.
    """
    scene, limits = shot.scene, shot.limits
    ends = shot.ray(line, type(line.x)(0)), shot.ray(line, line.length)
    flip = strongest_difference(scene, *ends, limits, hits)
    pair, nodes = flip.pair, (flip.pair.a, flip.pair.b)
    sides = [visit(scene, node, limits, hit) for node, hit in zip(nodes, flip.hits, strict=True)]
    event = classify(scene, *sides)
    (here, there), crosses = end_levels(shot, event, *nodes)
    crosses &= pair.weight > 0
    apart = dr.select(crosses & (here != there), here - there, 1)
    along = line.length * dr.select(crosses, here / apart, 0.5)

    edge = Edge(pair.path, event)
    slopes = slopes_of(shot, line, along, edge, FADING_BETWEEN, reaching(scene, hits[0]))
    finite = dr.isfinite(along) & dr.isfinite(slopes.along) & dr.isfinite(slopes.across)
    valid = crosses & finite & (slopes.along != 0)
    weight, _, change = areas(line, along, slopes, valid)
    here, there = (
        bright_below(scene, seen, limits, least, known)
        for seen, known in zip(sides, hits, strict=True)
    )
    rooted = valid & has_rooted_outline(scene, event) & (pair.weight >= 2 * limits.faint)
    share = dr.select(rooted, weight, 0)
    x, y = line.at(along)
    return Between(
        x=x,
        y=y,
        change=dr.select(valid, type(shot.size)(*change), 0),
        jump=dr.select(valid, here - there, 0),
        rooted=dr.select(slopes.along > 0, share, -share),
        edge=edge,
    )
