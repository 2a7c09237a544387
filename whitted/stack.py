"""A stack for each ray, in the local memory of its kernel."""

from dataclasses import dataclass

import drjit as dr

from .geometry import Array


@dataclass
class Stack:
    """Entries of a fixed shape (not frozen: Dr.Jit's loops write to their state)."""

    size: Array  # UInt32, as wide as the wavefront: Dr.Jit takes an index of width 1 to be equal in all its lanes
    slots: tuple  # one local buffer for each part of an entry
    capacity: int

    @staticmethod
    def allocate(capacity: int, size: Array, *parts: Array) -> "Stack":
        """An empty stack; without capacity it has no slots, and costs nothing.

        Args:
            size: UInt32 zeros, as wide as the wavefront.
            parts: arrays of the types that an entry consists of.
        """
        return Stack(size, tuple(dr.alloc_local(type(part), capacity) for part in parts) if capacity else (), capacity)

    def push(self, active: Array, *parts: Array) -> "Stack":
        """Add an entry in the active lanes; a full stack drops it.

        Without this limit in its code, a kernel could run with the smaller buffers of another: Dr.Jit takes two kernels
        for one that differ in nothing but the sizes of local buffers.
        """

        def write(stack, *parts):
            for slot, part in zip(stack.slots, parts, strict=True):
                slot.write(part, stack.size)
            return Stack(stack.size + 1, stack.slots, stack.capacity)

        fits = active & (self.size < self.capacity)
        return dr.if_stmt((self, *parts), fits, write, lambda stack, *_: stack)

    def pop(self, active: Array, *parts: Array) -> tuple:
        """Take the newest entry off in the active lanes.

        Args:
            parts: what the other lanes get.

        Returns:
            The stack, then the entry's parts.
        """

        def read(stack, *_):
            top = stack.size - 1
            return Stack(top, stack.slots, stack.capacity), *(slot.read(top) for slot in stack.slots)

        return dr.if_stmt((self, *parts), active, read, lambda *unchanged: unchanged)
