"""The plots of a report, each with a caption."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..files.atomic import atomically
from ..files.figures import figure_of, legend_below
from .analysis import fastest, front, slope
from .point_labels import label_points
from .store import Rows

# Groups of times that grow, and their axis of x
GROWTH = {
    "pixels": "number of pixels",
    "spheres": "number of spheres added",
    "lights": "number of lights added",
    "parameters": "number of parameters",
}
# What axes say of their numbers
TIME, RATIO = "median time of a call (ms)", " (1 is 100 %)"
# Logarithmic axes have no place for a compile time of 0, of a kernel that was in the cache
LEAST = 1e-3
FILES = tuple(
    f"{name}.png"
    for name in ("image", "limits", "gradient", "modes", "unrolled", *GROWTH, "compile", "memory")
)


@dataclass(frozen=True)
class Plot:
    """A file in the report's folder, and what it shows."""

    file: Path
    caption: str


def draw_plots(folder: Path, groups: Mapping[str, Rows], parameter: str) -> list[Plot]:
    """Draw all plots of a report.

    Args:
        groups: the measurements by the name of their experiment.
        parameter: whose derivative was measured.
    """
    return [
        _image(folder, groups),
        _limits(folder, groups),
        _gradient(folder, groups["gradient"], parameter),
        _modes(folder, groups["modes"], parameter),
        _unrolled(folder, groups["unrolled"]),
        *(_growth(folder, name, groups[name]) for name in GROWTH),
        _compiling(folder, groups),
        _memory(folder, groups["memory"]),
    ]


def _image(folder: Path, groups: Mapping[str, Rows]) -> Plot:
    rows = image_settings(groups)
    advice = "".join(
        f" For {100 * error:g} %, use {row['name']}: {row['ms']:.3g} ms."
        for error, row in fastest(rows)
    )
    label = f"relative RMS error of the image{RATIO}"
    _draw_errors(folder / "image.png", groups["image"], label, front(rows))
    return Plot(folder / "image.png", f"Error of the image against time.{advice}")


def image_settings(groups: Mapping[str, Rows]) -> Rows:
    """All measurements of images of one size against the same reference."""
    return [*groups["image"], *groups["depth"], *groups["importance"]]


def _limits(folder: Path, groups: Mapping[str, Rows]) -> Plot:
    shorter = [row | {"kind": "max_depth", "note": f"{row['depth']}"} for row in groups["depth"]]
    fainter = [
        row | {"kind": "min_importance", "note": f"{row['least']:g}"}
        for row in groups["importance"]
    ]
    label = f"relative RMS error of the image{RATIO}"
    _draw_errors(folder / "limits.png", shorter + fainter, label)
    caption = "Error against time with a lower max_depth or a higher min_importance, at spp 4."
    return Plot(folder / "limits.png", caption)


def _gradient(folder: Path, rows: Rows, parameter: str) -> Plot:
    label = f"relative RMS error{RATIO} of\nd image / d {parameter}"
    _draw_errors(folder / "gradient.png", rows, label, front(rows))
    plain, boundary = (
        min(row["error"] for row in rows if row["kind"] == kind)
        for kind in ("plain AD", "boundary")
    )
    return Plot(
        folder / "gradient.png",
        f"Error of d image / d {parameter} against time. "
        f"The least error of plain AD is {plain / boundary:.3g} times that of AD with edges.",
    )


def _modes(folder: Path, rows: Rows, parameter: str) -> Plot:
    label = f"relative error{RATIO} of a sum of\nd image / d {parameter}"
    _draw_errors(folder / "modes.png", rows, label)
    return Plot(
        folder / "modes.png",
        f"Error of one weighted sum of d image / d {parameter} against time, in forward mode, and "
        "in reverse mode by that parameter alone and by all parameters.",
    )


def _unrolled(folder: Path, rows: Rows) -> Plot:
    places = [(row["compile_s"], row["ms"]) for row in rows]
    figure, axes = figure_of(1, 3.4)
    axes.plot(*zip(*places, strict=True), "o-", ms=4, label="plain samples, 256 x 256 pixels")
    axes.set(
        xlabel="compile time (s)",
        ylabel=TIME,
        xlim=(0, None),
        ylim=(0, 1.3 * max(row["ms"] for row in rows)),
    )
    axes.grid(alpha=0.3)
    legend_below(figure)
    label_points(figure, axes, places, [f"unroll={row['x']}" for row in rows])
    _save(folder / "unrolled.png", figure)
    caption = (
        "Time against compile time, by the levels of the tree of rays that are straight code in "
        "front of a loop."
    )
    return Plot(folder / "unrolled.png", caption)


def _growth(folder: Path, name: str, rows: Rows) -> Plot:
    kinds = dict.fromkeys(row["kind"] for row in rows)
    exponents = ", ".join(
        f"{kind} {slope([row for row in rows if row['kind'] == kind]):.2f}" for kind in kinds
    )
    _draw_growth(folder / f"{name}.png", rows, GROWTH[name], "ms", TIME)
    caption = f"Time against the {GROWTH[name]}. Exponent of growth: {exponents}."
    return Plot(folder / f"{name}.png", caption)


def _compiling(folder: Path, groups: Mapping[str, Rows]) -> Plot:
    rows = [row | {"kind": name} for name in ("spheres", "lights") for row in groups[name]]
    added = "number of spheres or lights added"
    _draw_growth(folder / "compile.png", rows, added, "compile_s", "compile time (s)")
    caption = f"Compile time of the kernel of plain samples, against the {added}."
    return Plot(folder / "compile.png", caption)


def _memory(folder: Path, rows: Rows) -> Plot:
    _draw_growth(folder / "memory.png", rows, "number of pixels", "mib", "peak memory (MiB)")
    return Plot(folder / "memory.png", "Peak memory of a process that renders one image.")


def _draw_errors(path: Path, rows: Rows, label: str, best: Rows | None = None) -> None:
    """Draw error against time, a line for each kind, a horizontal line for a reference's error.

    Args:
        rows: a "note" is written beside the point; without one, the name less the kind.
        label: of the axis of errors.
        best: the Pareto front, drawn as a dotted line.
    """
    figure, axes = figure_of(1, 4.8)
    timed = sorted((row for row in rows if "ms" in row), key=lambda row: row["ms"])
    for kind in dict.fromkeys(row["kind"] for row in rows if "ms" in row):
        own = [row for row in timed if row["kind"] == kind]
        ms, errors, spreads = ([row[key] for row in own] for key in ("ms", "error", "spread"))
        axes.errorbar(ms, errors, xerr=spreads, fmt="o-", ms=4, label=kind)
    if best:
        ms, errors = ([row[key] for row in best] for key in ("ms", "error"))
        axes.plot(ms, errors, "k:", lw=1, label="Pareto front")
    for row in rows:
        if row["kind"] == "floor":
            axes.axhline(row["error"], color="0.6", lw=1, label=row["name"])
    _finish(figure, axes, TIME, label)
    notes = [row.get("note", row["name"].removeprefix(f"{row['kind']}, ")) for row in timed]
    label_points(figure, axes, [(row["ms"], row["error"]) for row in timed], notes)
    _save(path, figure)


def _draw_growth(path: Path, rows: Rows, x_label: str, key: str, y_label: str) -> None:
    """Draw one entry of the measurements against x, a line for each kind."""
    figure, axes = figure_of(1, 3.4)
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        y = [max(row[key], LEAST) for row in own]
        axes.plot([row["x"] for row in own], y, "o-", ms=4, label=kind)
    _finish(figure, axes, x_label, y_label)
    _save(path, figure)


def _finish(figure: Any, axes: Any, x_label: str, y_label: str) -> None:
    from matplotlib.ticker import LogFormatter

    axes.set(xscale="log", yscale="log", xlabel=x_label, ylabel=y_label)
    for axis in (axes.xaxis, axes.yaxis):
        # Plain numbers, in place of powers of ten
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(LogFormatter(minor_thresholds=(1.5, 0.4)))
    axes.grid(alpha=0.3)
    legend_below(figure)


def _save(path: Path, figure: Any) -> None:
    atomically(path, lambda temporary: figure.savefig(temporary))
