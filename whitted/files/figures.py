"""Plots, drawn without a display by matplotlib, an optional dependency."""

from typing import Any


def figure_of(rows: int, height: float = 3) -> tuple[Any, Any]:
    """An empty figure with panels below each other.

    Args:
        rows: the number of panels.
        height: of each panel, in inches.

    Returns:
        The figure, and its panel, or an array of its panels if there are several.

    Raises:
        RuntimeError: matplotlib is not installed.
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


def legend_below(figure: Any, columns: int = 2) -> None:
    """A legend of all panels below them, where it covers nothing."""
    figure.legend(loc="outside lower center", ncols=columns, fontsize=8)
