"""A stack for each ray, in the local memory of its kernel."""

from dataclasses import dataclass
from typing import Any

import drjit as dr

from .arrays import Array
from .pytree import leaves, like


@dataclass
class Stack:
    """Entries of one structure (not frozen: Dr.Jit's loops write to their state)."""

    # UInt32, as wide as the wavefront: Dr.Jit takes an index of width 1 to be equal in all lanes
    size: Array
    slots: tuple  # a local buffer for each array of an entry
    capacity: int

    @staticmethod
    def allocate(capacity: int, size: Array, entry: Any) -> "Stack":
        """An empty stack; without capacity it has no slots, and costs nothing.

        Args:
            size: UInt32 zeros, as wide as the wavefront.
            entry: any entry, a structure of arrays whose types are taken.
        """
        slots = (dr.alloc_local(type(part), capacity) for part in leaves(entry)) if capacity else ()
        return Stack(size, tuple(slots), capacity)

    def push(self, active: Array, entry: Any) -> "Stack":
        """Add an entry in the active lanes; a full stack drops it.

        The capacity has to be in the code. Dr.Jit takes two kernels for the same that differ in
        nothing but the sizes of local buffers, and would run one with the smaller buffers of the
        other.
        """

        def write(stack, *parts):
            for slot, part in zip(stack.slots, parts, strict=True):
                slot.write(part, stack.size)
            return Stack(stack.size + 1, stack.slots, stack.capacity)

        fits = active & (self.size < self.capacity)
        return dr.if_stmt((self, *leaves(entry)), fits, write, lambda stack, *_: stack)

    def pop(self, active: Array, other: Any) -> tuple["Stack", Any]:
        """Take the newest entry off in the active lanes; the others get `other`."""

        def read(stack, *_):
            top = stack.size - 1
            return Stack(top, stack.slots, stack.capacity), *(
                slot.read(top) for slot in stack.slots
            )

        stack, *parts = dr.if_stmt(
            (self, *leaves(other)), active, read, lambda *unchanged: unchanged
        )
        return stack, like(other, parts)
