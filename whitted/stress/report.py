"""The report of the stress suite: a page, charts, and a CSV of all checks."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..files.atomic import atomically, write_text
from ..files.figures import figure_of, legend_below
from ..files.pages import page_template
from .case import Case, Chart, Curve
from .suite import Result, slug

# A logarithmic axis has no place for errors of 0; they are drawn here, below any rounding error
LEAST_ERROR = 1e-18
COLUMNS = "number", "case", "precision", "check", "error", "bound", "result", "seconds of the case"


@dataclass(frozen=True)
class Plot:
    """A file with the chart of a case, and where each of its methods breaks, in words."""

    file: Path
    breaks: list[str]


@dataclass(frozen=True)
class Section:
    """A case in the page."""

    case: Case
    results: list[Result]
    plot: Plot | None


def require_libraries() -> None:
    """Find out that a library is missing before the cases run, not after them.

    Raises:
        RuntimeError: matplotlib or Jinja2 is not installed.
    """
    figure_of(1)
    page_template(__package__, "report.html")


def names(cases: Sequence[Case]) -> list[str]:
    """The files that `write` makes of the results of some cases, the page last."""
    charts = [chart_name(case) for case in cases if case.chart is not None]
    return [*charts, "results.csv", "report.html"]


def chart_name(case: Case) -> str:
    return f"{case.number:02d}-{slug(case)}.png"


def write(folder: Path, results: Sequence[Result]) -> list[Path]:
    """Write the charts, `results.csv` and `report.html`.

    Returns:
        The files, the page last.
    """
    plots: dict[int, Plot] = {}
    cases = list(dict.fromkeys(result.case for result in results))
    for case in cases:
        if case.chart is not None:
            chart, file = case.chart(), folder / chart_name(case)
            draw(file, chart)
            plots[case.number] = Plot(file, [describe_break(c, chart) for c in chart.curves])
    files = [folder / name for name in names(cases)]
    *_, table, page = files
    atomically(table, lambda temporary: _write_csv(temporary, results))
    write_text(page, report(results, plots))
    return files


def break_index(curve: Curve, chart: Chart) -> int | None:
    """Where a method breaks: the first error above the tolerance, from the side where it works.

    Returns:
        The index in the curve; None where the method never breaks.
    """
    broken = _broken(curve, chart)
    if not broken.any():
        return None
    breaks_upward = broken[-1] or not broken[0]
    return int(np.flatnonzero(broken)[0 if breaks_upward else -1])


def describe_break(curve: Curve, chart: Chart) -> str:
    """Where a method breaks, in words."""
    index = break_index(curve, chart)
    if index is None:
        return f"{curve.label}: holds"
    if _broken(curve, chart).all():
        return f"{curve.label}: broken throughout"
    return f"{curve.label}: breaks at {curve.x[index]:.2g}"


def _broken(curve: Curve, chart: Chart) -> np.ndarray:
    """Which errors are above the tolerance or NaN."""
    return ~(np.asarray(curve.y, np.float64) <= chart.tolerance)


def draw(path: Path, chart: Chart) -> None:
    """Draw a chart: errors on a logarithmic axis, with a ring where each method breaks."""
    figure, axes = figure_of(1, 3.4)
    for curve in chart.curves:
        _draw_curve(axes, curve, chart)
    label = f"tolerance: {chart.tolerance:g}"
    axes.axhline(chart.tolerance, color="gray", linestyle=":", linewidth=1, label=label)
    xscale = "linear" if chart.linear else "log"
    axes.set_title(chart.title, fontsize=10)
    axes.set(xlabel=chart.x, ylabel=chart.y, xscale=xscale, yscale="log")
    axes.grid(alpha=0.25)
    legend_below(figure)
    atomically(path, lambda temporary: figure.savefig(temporary))


def _draw_curve(axes: Any, curve: Curve, chart: Chart) -> None:
    y = np.maximum(np.asarray(curve.y, np.float64), LEAST_ERROR)
    # Single precision is solid, double dashed
    style = "--" if "double" in curve.label else "-"
    label = describe_break(curve, chart)
    (line,) = axes.plot(curve.x, y, style, marker=".", markersize=4, label=label)
    index = break_index(curve, chart)
    if index is not None and np.isfinite(y[index]):
        ring = {"markersize": 10, "fillstyle": "none", "color": line.get_color()}
        axes.plot(curve.x[index], y[index], "o", **ring)


def _write_csv(path: Path, results: Sequence[Result]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for result in results:
            case, seconds = result.case, f"{result.seconds:.2f}"
            for check in result.checks:
                numbers = f"{check.error:.6e}", f"{check.bound:.6e}"
                verdict = "pass" if check.passed else "FAIL"
                start = case.number, case.name, result.precision, check.what
                writer.writerow([*start, *numbers, verdict, seconds])


def report(results: Sequence[Result], plots: Mapping[int, Plot]) -> str:
    """The page as HTML.

    Args:
        plots: by the number of their case.
    """
    sections = [
        Section(case, [one for one in results if one.case is case], plots.get(case.number))
        for case in dict.fromkeys(result.case for result in results)
    ]
    return page_template(__package__, "report.html").render(
        sections=sections,
        checks=sum(len(result.checks) for result in results),
        failed=sum(not result.passed for result in results),
    )
