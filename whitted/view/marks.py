"""What is drawn over a picture: the outline of what is picked, and the edges between labels."""

import drjit as dr
from drjit.llvm import ad

from ..core.arrays import Array
from ..core.derivatives import LOCK
from ..core.frozen import frozen
from ..edges.kernels import labelled_image
from ..rendering.job import BoundaryJob
from ..rendering.pick import indices
from ..scene.scene import Scene

# Bits of a pixel's mark
OUTLINE, EDGE = 1, 2
# Half the width of an outline, in pixels
REACH = 1


def outline(scene: Scene, resolution: tuple[int, int], number: int) -> Array:
    """The outline of a shape as it is seen: UInt32 for each pixel, row by row, OUTLINE or 0.

    Args:
        number: of the shape, as of `Scene.number_of`.
    """
    found, size = indices(scene, resolution), _numbers(*resolution)
    with LOCK:
        return _outline(found, *size, dr.opaque(ad.UInt32, number), resolution[0] * resolution[1])


def label_edges(scene: Scene, resolution: tuple[int, int], max_depth: int) -> Array:
    """Pixels whose label differs from that of the next one, right or below: EDGE or 0.

    Labels are those of one sample a pixel. An image is corrected where these edges are.
    """
    width, height = resolution
    with LOCK:
        job = BoundaryJob(scene, scene.given, resolution, max_depth, 1, None)
        band = job.band(0, height)
        *_, labels = labelled_image(scene.structure, job.parameters, band.film(1), job.limits)
        return _label_edges(labels, *_numbers(width, height), width * height)


def _numbers(*numbers: int) -> tuple[Array, ...]:
    return tuple(dr.opaque(ad.Int, n) for n in numbers)


def _places(count: int, width: Array) -> tuple[Array, Array]:
    """Column and row of each pixel; below 2^23 the quotient of floats is exact."""
    index = dr.arange(ad.Int, count)
    row = ad.Int((ad.Float(index) + 0.5) / ad.Float(width))
    return index - row * width, row


@frozen
def _outline(found: Array, width: Array, height: Array, number: Array, count: int) -> Array:
    x, y = _places(count, width)

    def inside(dx: int, dy: int) -> Array:
        column = dr.clip(x + dx, 0, width - 1)
        row = dr.clip(y + dy, 0, height - 1)
        return dr.gather(ad.UInt32, found, ad.UInt32(row * width + column)) == number

    own = inside(0, 0)
    differs = own & False
    for dx, dy in ((REACH, 0), (-REACH, 0), (0, REACH), (0, -REACH)):
        differs |= inside(dx, dy) != own
    return dr.select(differs, ad.UInt32(OUTLINE), 0)


@frozen
def _label_edges(labels: Array, width: Array, height: Array, count: int) -> Array:
    x, y = _places(count, width)

    def label(dx: int, dy: int) -> Array:
        # Around the picture there is a margin of one pixel
        return dr.gather(type(labels), labels, ad.UInt32((y + 1 + dy) * (width + 2) + x + 1 + dx))

    own = label(0, 0)
    differs = (label(1, 0) != own) | (label(0, 1) != own)
    return dr.select(differs, ad.UInt32(EDGE), 0)
