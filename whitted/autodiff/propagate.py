"""Derivatives through a small graph: forward from its inputs, or back from an output."""

import drjit as dr

from ..core.arrays import Array


def push_forward(inputs: object) -> None:
    """Propagate the inputs' tangents to all that depends on them, and keep those in between."""
    dr.enqueue(dr.ADMode.Forward, inputs)
    dr.traverse(dr.ADMode.Forward, flags=dr.ADFlag.ClearEdges)


def pull_back(output: Array, adjoint: Array) -> None:
    """Propagate an output's adjoint to all that it depends on."""
    dr.set_grad(output, adjoint)
    dr.enqueue(dr.ADMode.Backward, output)
    dr.traverse(dr.ADMode.Backward)
