"""Plots, drawn without a display by matplotlib, which is an extra."""

from typing import Any


def figure_of(rows: int, height: float = 3) -> tuple[Any, Any]:
    """An empty figure with panels of some inches' height below each other, and the panels.

    Raises:
        RuntimeError: there is no matplotlib.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise RuntimeError(
            "plots need matplotlib, which is missing; install it with: pip install 'whitted[fit]'"
        ) from None
    figure = Figure(figsize=(8, height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, 1, sharex=True)
