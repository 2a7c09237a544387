"""Derivatives of rows that lanes gather from one long array.

Dr.Jit's own derivative of a gather in a loop would need an array of all derivatives in each step.
Here the rows that a lane has gathered get gradients of their own. Forward mode brings them their
tangents; reverse mode adds their derivatives to an array.
"""

from typing import Any

import drjit as dr

from .arrays import Array


class Gathered:
    """Rows that were gathered since the last step of a walk.

    Dr.Jit does not look into this object, which holds the array that reverse mode adds to.
    """

    def __init__(self, tangents: Array = None, sums: Array = None) -> None:
        """Begin without rows.

        Args:
            tangents: of the array, in forward mode.
            sums: what derivatives are added to, in reverse mode.
        """
        self.tangents, self.sums = tangents, sums
        self.rows: list[Array] = []
        self._places: list[tuple[Array, Array]] = []

    def anew(self) -> "Gathered":
        """The same without rows."""
        return Gathered(self.tangents, self.sums)

    def attach(self, row: Any, place: Array, active: Array) -> Any:
        """Give a row gradients of its own.

        Args:
            row: the numbers that were gathered, detached.
            place: where in the array the row is, in rows.
            active: Bool: the lanes that have gathered it.
        """
        dr.enable_grad(row)
        if self.tangents is not None:
            dr.set_grad(row, dr.gather(type(row), self.tangents, place, active))
        self.rows.append(row)
        self._places.append((place, active))
        return row

    def add(self) -> None:
        """Add the derivatives that reverse mode has brought to the rows."""
        for row, (place, active) in zip(self.rows, self._places, strict=True):
            slope = dr.grad(row)
            dr.scatter_add(self.sums, slope, place, active & dr.any(slope != 0))
