"""What an edge's level function does around the edge, and the areas that the edge divides."""

from dataclasses import dataclass

import drjit as dr

from ..autodiff.forward import Direction, RaySlopes
from ..autodiff.propagate import push_forward
from ..core.arrays import Array, precision_of
from ..core.numerics import smooth_step
from ..core.ray import Ray
from ..scene.scene import Scene
from ..tracing.node import Limits
from ..tracing.primary import CameraFrame, image_ray
from ..tracing.record import Hits
from ..tracing.surface import boards
from .events import Kind, board_place, crease
from .motion import Edge, level_jvp
from .settings import LEAST_TILT, TOUCHING


@dataclass
class Line:
    """The line from a sample a to its right or lower neighbour b.

    Distances are from a, in pixels. (Not frozen: Dr.Jit's loops write to their state.)
    """

    x: Array  # image position of a
    y: Array
    vertical: Array  # Bool: b is below, not to the right
    length: Array  # from a to b

    def at(self, along: Array) -> tuple[Array, Array]:
        """The image position at a distance from a."""
        right, down = dr.select(self.vertical, 0, along), dr.select(self.vertical, along, 0)
        return self.x + right, self.y + down


@dataclass(frozen=True)
class Shot:
    """A scene as the camera of an image of some size sees it."""

    scene: Scene
    frame: CameraFrame
    size: Array
    limits: Limits

    def ray(self, line: Line, along: Array) -> Ray:
        """The ray through a place on a line."""
        return image_ray(self.frame, self.size, *line.at(along))


@dataclass(frozen=True)
class Slopes:
    """What an edge's level function does around the edge."""

    along: Array  # its slope along the segment, per pixel
    across: Array  # and across it
    counts: Array  # how much of the edge's motion counts
    # The cosines at which the surfaces of a crease are met, in units of the angle that the ray
    # turns by from one sample to the next
    cosines: tuple[Array, Array]


def image_slopes(shot: Shot, at: tuple[Array, Array]) -> tuple[Ray, RaySlopes]:
    """The rays through some image positions, and their slopes as these move right and down."""
    slopes = []
    for axis in range(2):
        at = dr.detach(at)
        dr.enable_grad(at[axis])
        ray = image_ray(shot.frame, shot.size, *at)
        dr.set_grad(at[axis], 1)
        push_forward(at[axis])
        slopes.append((dr.grad(ray.o), dr.grad(ray.d)))
    return dr.detach(ray), slopes


def slopes_of(
    shot: Shot,
    line: Line,
    along: Array,
    edge: Edge,
    fading: tuple[float, float, float],
    hits: Hits | None = None,
) -> Slopes:
    """The slopes of an edge's level function, by moving the image position.

    Args:
        fading: up to how many cells of a checkerboard from one sample to the next an edge's motion
            counts in full, from how many on it does not count, and from which distance on, in
            cells; up to half that distance, it always counts in full.
        hits: of `level_jvp`.
    """
    at_rest = [Direction(shot.scene, {})] * 2
    rays = image_slopes(shot, line.at(along))
    (right, down), arriving = level_jvp(at_rest, *rays, shot.limits, edge, hits)
    vertical, length = line.vertical, line.length
    turn = dr.norm(dr.select(vertical, down.turn, right.turn)) * length
    on, other, angle = crease(shot.scene, arriving, edge.event)
    counts = dr.select(angle > TOUCHING[precision_of(along).name], type(along)(1), 0)
    if boards(shot.scene):
        across = dr.fmax(dr.abs(right.column), dr.abs(right.row))
        most = dr.fmax(across, dr.fmax(dr.abs(down.column), dr.abs(down.row))) * length
        away = board_place(shot.scene, arriving, edge.event)[2]
        full, none, far = fading
        small = smooth_step(full, none, most) * smooth_step(far / 2, far, away)
        counts = dr.select(edge.event.kind == Kind.CELL, 1 - small, counts)
    return Slopes(
        along=dr.select(vertical, down.level, right.level),
        across=dr.select(vertical, right.level, down.level),
        counts=counts,
        cosines=(on / turn, other / turn),
    )


def areas(
    line: Line, along: Array, slopes: Slopes, valid: Array
) -> tuple[Array, tuple[Array, Array], tuple[Array, Array]]:
    """The share of the edge, and the areas that it moves between the cells of a and b.

    The line stands for a strip as wide as it is long. In it the edge is
    straight.

    Returns:
        The share, the areas, and the areas for a unit of growth of the level function.
    """
    slope, across, length = slopes.along, slopes.across, line.length
    # Scaled, since fourth powers would leave the range of single precision
    largest = dr.fmax(dr.abs(slope), dr.abs(across))
    u, v = dr.square(slope / largest), dr.square(across / largest)
    weight = dr.select(valid, u * u / dr.fma(u, u, v * v), 0)
    # Half of how far the edge shifts along the pair, from one line of samples to the next
    tilt = length / 2 * dr.fmin(dr.fmax(dr.abs(across / slope), LEAST_TILT), 1)
    past = along - length / 2
    within = -(tilt - past) * (tilt - past) / (4 * tilt)
    a = dr.select(dr.abs(past) < tilt, within, dr.fmin(past, 0))
    moved = a * (weight * length), (past - a) * (weight * length)
    share = dr.fmin(dr.fmax(0.5 - past / (2 * tilt), 0), 1)
    growth = -length * slopes.counts * weight / slope
    return weight, moved, (share * growth, (1 - share) * growth)
