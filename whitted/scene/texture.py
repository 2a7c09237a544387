"""The checkerboard: its parameters, its colours, and where its cells end.

The two world coordinates other than the axis along which the normal is largest are u and v. A cell
is a square of the given size; cells whose column and row add up to an odd number have the board's
colour, the others that of the material.
"""

from dataclasses import dataclass

import drjit as dr

from ..core.arrays import Array
from ..core.parameter import POSITIVE, UNIT, Scale, parameter


@dataclass(frozen=True)
class Checkerboard:
    """A board on the flat shapes of a material."""

    color: Array = parameter(3, UNIT)
    size: Array = parameter(1, POSITIVE, scale=Scale(1 / 4, "value"))

    def cell(self, p: Array, normal: Array) -> tuple[Array, Array]:
        """Column and row of the cell that a point is in, as real numbers."""
        u, v = coordinates(p, normal)
        return dr.floor(u / self.size), dr.floor(v / self.size)

    def odd(self, p: Array, normal: Array) -> Array:
        """Bool: a point is in a cell of the board's own colour."""
        column, row = self.cell(p, normal)
        cells = column + row
        return cells - 2 * dr.floor(cells / 2) != 0

    def level(self, p: Array, normal: Array, axis: Array, border: Array) -> Array:
        """The distance of a point from where the cell of a number begins: the level function of an
        edge between cells.

        Args:
            axis: 0 for columns, 1 for rows.
            border: the number of the column or row.
        """
        u, v = coordinates(p, normal)
        return dr.select(axis == 0, u, v) - border * self.size


def coordinates(p: Array, normal: Array) -> tuple[Array, Array]:
    """u and v: the coordinates of p off the normal's largest axis."""
    size_x, size_y, size_z = abs(normal.x), abs(normal.y), abs(normal.z)
    drop_x = (size_x >= size_y) & (size_x >= size_z)
    drop_y = ~drop_x & (size_y >= size_z)
    return dr.select(drop_x, p.y, p.x), dr.select(drop_x | drop_y, p.z, p.y)
