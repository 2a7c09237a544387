"""Plots, drawn without a display by matplotlib, an optional dependency."""

from typing import Any

# Of a legend: characters in a line, and those that the mark of an entry takes; inches of a row
LINE, MARK, ROW = 92, 9, 0.16


def figure_of(rows: int, height: float = 2.4) -> tuple[Any, Any]:
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
    figure = Figure(figsize=(6.4, height * rows), dpi=140, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, 1, sharex=True)


def legend_below(figure: Any) -> None:
    """A legend of all panels below them, where it covers nothing; the figure grows by it."""
    labels = [label for axes in figure.axes for label in axes.get_legend_handles_labels()[1]]
    columns = max(1, min(len(labels), LINE // (max(map(len, labels), default=0) + MARK)))
    figure.set_figheight(figure.get_figheight() + ROW * (1 + -(-len(labels) // columns)))
    figure.legend(loc="outside lower center", ncols=columns, fontsize=8)
