"""What the stress suite leaves behind: charts, a table of all checks as CSV, and a page that shows
both.
"""

import csv
import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..files.atomic import atomically, write_text
from ..files.figures import figure_of
from .case import Chart, Curve
from .suite import Result, slug

# Zeros have no place among powers of ten: they are drawn here
FLOOR = 1e-18
STYLE = """body { font: 15px/1.5 sans-serif; max-width: 62em; margin: 2em auto; padding: 0 1em }
table { border-collapse: collapse } td, th { padding: .1em .8em .1em 0; text-align: left; vertical-align: top }
.FAIL { color: #b2182b; font-weight: bold } .pass { color: #1a7837 } img { max-width: 100% } details { margin: .5em 0 }"""


def write(folder: Path, results: Sequence[Result]) -> list[Path]:
    """Write charts, `results.csv` and `report.html`.

    Returns:
        The files, the report last.
    """
    files: list[Path] = []
    charts: dict[int, tuple[str, list[str]]] = {}
    for case in dict.fromkeys(result.case for result in results):
        if case.chart is not None:
            chart = case.chart()
            path = folder / f"{case.number:02d}-{slug(case)}.png"
            atomically(path, lambda temporary, chart=chart: draw(temporary, chart))  # type: ignore[misc]
            charts[case.number] = path.name, [told_break(curve, chart) for curve in chart.curves]
            files.append(path)
    table, page = folder / "results.csv", folder / "report.html"
    atomically(table, lambda temporary: _write_csv(temporary, results))
    text = _page(results, charts)
    write_text(page, text)
    return [*files, table, page]


def breaking(curve: Curve, chart: Chart) -> int | None:
    """Where a method breaks: the first point, coming from the side where it works, with an error
    above what is tolerated.

    Returns:
        The point's place in the curve; None where it never breaks.
    """
    broken = ~(np.asarray(curve.y, np.float64) <= chart.broken)
    if not broken.any():
        return None
    rising = broken[-1] or not broken[0]
    return int(np.flatnonzero(broken)[0] if rising else np.flatnonzero(broken)[-1])


def told_break(curve: Curve, chart: Chart) -> str:
    """Where a method breaks, in words."""
    at = breaking(curve, chart)
    if at is None:
        return f"{curve.label}: holds"
    if not (np.asarray(curve.y, np.float64) <= chart.broken).any():
        return f"{curve.label}: broken throughout"
    return f"{curve.label}: breaks at {curve.x[at]:.2g}"


def draw(path: Path, chart: Chart) -> None:
    """Draw a chart: errors in powers of ten, a ring where each method breaks."""
    figure, axes = figure_of(1, 5)
    for k, curve in enumerate(chart.curves):
        _draw_curve(axes, curve, chart, k)
    axes.axhline(
        chart.broken,
        color="gray",
        linestyle=":",
        linewidth=1,
        label=f"broken above {chart.broken:g}",
    )
    axes.set(
        title=chart.title,
        xlabel=chart.x,
        ylabel=chart.y,
        yscale="log",
        xscale="linear" if chart.linear else "log",
    )
    axes.grid(alpha=0.25)
    axes.legend(fontsize=7.5)
    figure.savefig(path, dpi=110)


def _draw_curve(axes: Any, curve: Curve, chart: Chart, k: int) -> None:
    y = np.maximum(np.asarray(curve.y, np.float64), FLOOR)
    at = breaking(curve, chart)
    # One dash for each precision, so that a method keeps its colour only if it is alone
    (drawn,) = axes.plot(
        curve.x,
        y,
        "--" if "double" in curve.label else "-",
        marker=".",
        markersize=4,
        label=told_break(curve, chart),
    )
    if at is not None and np.isfinite(y[at]):
        axes.plot(curve.x[at], y[at], "o", markersize=10, fillstyle="none", color=drawn.get_color())


def _write_csv(path: Path, results: Sequence[Result]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(
            [
                "number",
                "case",
                "precision",
                "check",
                "error",
                "bound",
                "result",
                "seconds of the case",
            ]
        )
        for result in results:
            for check in result.checks:
                verdict = "pass" if check.passed else "FAIL"
                numbers = f"{check.error:.6e}", f"{check.bound:.6e}"
                writer.writerow(
                    [
                        result.case.number,
                        result.case.name,
                        result.precision,
                        check.what,
                        *numbers,
                        verdict,
                        f"{result.seconds:.2f}",
                    ]
                )


def _page(results: Sequence[Result], charts: dict[int, tuple[str, list[str]]]) -> str:
    cases = list(dict.fromkeys(result.case for result in results))
    failed = sum(not result.passed for result in results)
    checks = sum(len(result.checks) for result in results)
    verdict = (
        f"<span class=FAIL>{failed} failed</span>" if failed else "<span class=pass>all pass</span>"
    )
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><title>whitted: stress suite</title><style>{STYLE}</style>",
        "<h1>Where ray tracing is hard</h1>",
        f"<p>{len(cases)} cases in float32 and float64, {checks} checks: {verdict}. Each bound is argued from "
        "floating point, next to its case; ulp is the spacing of a precision's numbers. All figures: "
        "<a href=results.csv>results.csv</a>.</p>",
    ]
    for case in cases:
        own = [result for result in results if result.case is case]
        parts.append(f"<h2 id=case{case.number}>{case.number}. {html.escape(case.name)}</h2>")
        parts.append(f"<p>Right: {html.escape(case.answer)}.<br>Bound: {html.escape(case.why)}")
        parts.append(
            f"<br>Limit of single precision: {html.escape(case.limit)}.</p>"
            if case.limit
            else "</p>"
        )
        parts += [_table(result) for result in own]
        if case.number in charts:
            name, breaks = charts[case.number]
            parts.append(
                f"<p><img src='{name}' alt='{html.escape('; '.join(breaks), quote=True)}'></p>"
            )
    return "\n".join(parts) + "\n</html>\n"


def _table(result: Result) -> str:
    verdict = "pass" if result.passed else "FAIL"
    tight = result.tightest
    head = f"{result.precision}: <span class={verdict}>{verdict}</span>, {len(result.checks)} checks; nearest to its bound: "
    head += f"{html.escape(tight.what)}, {tight.error:.2e} of {tight.bound:.2e}"
    rows = "".join(
        f"<tr><td>{html.escape(check.what)}<td>{check.error:.2e}<td>{check.bound:.2e}"
        f"<td class={'pass' if check.passed else 'FAIL'}>{'pass' if check.passed else 'FAIL'}</tr>"
        for check in result.checks
    )
    opened = "" if result.passed else " open"
    return f"<details{opened}><summary>{head}</summary><table><tr><th>check<th>error<th>bound<th></tr>{rows}</table></details>"
