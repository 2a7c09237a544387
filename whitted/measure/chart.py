"""Charts of a scene's speed against its accuracy: measured, drawn, and told in one page."""

import csv
import hashlib
import html
import io
import platform
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..files.atomic import atomically, write_text
from ..files.figures import figure_of
from .about import features, system
from .experiments import Experiments
from .store import Rows, Store

# Error levels for which the cheapest setting is told
LEVELS = (0.05, 0.02, 0.01, 0.005)
SCALING = {
    "pixels": "pixels",
    "spheres": "spheres added",
    "lights": "lights added",
    "parameters": "parameters",
}


def chart(
    scene: Path,
    folder: Path,
    release: str,
    *,
    size: tuple[int, int] | None = None,
    quick: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> Path:
    """Measure a scene, and write a report: an HTML page, plots, the numbers as CSV, and all that
    was measured as JSON.

    What has been measured before under the same conditions is kept, so that an interrupted run goes
    on.

    Args:
        scene: a scene file.
        folder: is made if it is not there.
        release: of this package, for the report.
        size: width and height of the images whose errors are measured [default: 192 x 192, or 96 x
            96 if quick].
        quick: fewer samples, rounds and sizes.
        progress: called with the fraction done, in (0, 1], and the name of the group that comes
            next.

    Returns:
        The HTML page.

    Raises:
        SceneError: the scene file is not valid.
        RuntimeError: there is no matplotlib.
        OSError: a file cannot be written.
    """
    figure_of(1)
    size = size or ((96, 96) if quick else (192, 192))
    experiments = Experiments(scene, size, quick)
    folder.mkdir(exist_ok=True)
    facts = conditions(scene, release, experiments)
    store = Store(folder / "measured.json", facts)
    groups: dict[str, Rows] = {}
    for k, (name, measure) in enumerate(experiments.groups.items()):
        if progress is not None:
            progress((k + 1) / (len(experiments.groups) + 1), name)
        groups[name] = store.group(name, measure)
        write_text(folder / f"{name}.csv", _table(groups[name]))
    drawn = _draw_all(folder, groups, experiments)
    page = folder / "report.html"
    write_text(page, report(scene.stem, facts, groups, drawn))
    return page


def conditions(scene: Path, release: str, experiments: Experiments) -> dict[str, Any]:
    """What the measurements depend on."""
    facts = system()
    return {
        "scene": scene.name,
        "scene SHA-256": hashlib.sha256(scene.read_bytes()).hexdigest(),
        "image": "{} x {}".format(*experiments.size),
        "compiled in": ", ".join(features(experiments.scenes["single"])),
        "quick": experiments.quick,
        "machine": platform.processor() or platform.machine(),
        "threads": facts["threads"],
        "vector width": facts["vector width"],
        "Dr.Jit": facts["Dr.Jit"],
        "libLLVM": Path(facts["libLLVM"].split(" ")[0]).name,
        "Python": platform.python_version(),
        "whitted": release,
    }


def front(rows: Rows) -> Rows:
    """The measurements that no other betters in both time and error, the fastest first."""
    best: Rows = []
    for row in sorted(
        (row for row in rows if "ms" in row), key=lambda row: (row["ms"], row["error"])
    ):
        if not best or row["error"] < best[-1]["error"]:
            best.append(row)
    return best


def slope(rows: Rows) -> float:
    """The exponent of x in the time, of the larger half of the measurements, where fixed costs are
    outweighed.
    """
    ordered = sorted(rows, key=lambda row: row["x"])
    large = ordered[len(ordered) // 2 :] if len(ordered) > 3 else ordered
    if len(large) < 2:
        return float("nan")
    return float(
        np.polyfit(np.log([row["x"] for row in large]), np.log([row["ms"] for row in large]), 1)[0]
    )


def _draw_all(
    folder: Path, groups: Mapping[str, Rows], experiments: Experiments
) -> list[tuple[str, str]]:
    """All plots: file name and what it says."""
    name, component = experiments.subject()
    subject = f"{name}.{component}" if component else name
    images = [*groups["image"], *groups["depth"], *groups["importance"]]
    told = [f"for {100 * level:g} % take {best}" for level, best in _advice(images)]
    drawn = [
        ("image.png", "Error of the image against time. " + ("; ".join(told) + "." if told else ""))
    ]
    _errors(folder / "image.png", groups["image"], front(images), "relative RMSE of the image")
    drawn.append(
        (
            "limits.png",
            "What shorter chains of rays and a least importance save, and what they lose, at spp 4.",
        )
    )
    _errors(
        folder / "limits.png",
        [row | {"kind": key} for key in ("depth", "importance") for row in groups[key]],
        [],
        "relative RMSE",
    )
    plain, ours = (
        min(row["error"] for row in groups["gradient"] if row["kind"] == kind)
        for kind in ("plain AD", "boundary")
    )
    text = f"Error of d image / d {subject} against time. The least error of plain AD is {plain / ours:.3g} times that with edges."
    drawn.append(("gradient.png", text))
    _errors(
        folder / "gradient.png",
        groups["gradient"],
        front(groups["gradient"]),
        f"relative L2 error by {subject}",
    )
    text = f"Error of the derivative by {subject}, along the right one, against time: forward and reverse, by it alone and by all"
    drawn.append(("modes.png", text))
    _errors(folder / "modes.png", groups["modes"], [], "relative error along the derivative")
    for key, label in SCALING.items():
        kinds = dict.fromkeys(row["kind"] for row in groups[key])
        slopes = ", ".join(
            f"{kind} {slope([r for r in groups[key] if r['kind'] == kind]):.2f}" for kind in kinds
        )
        drawn.append((f"{key}.png", f"Time against {label}; exponents: {slopes}."))
        _powers(folder / f"{key}.png", groups[key], label, "ms", "ms")
    drawn.append(
        (
            "compile.png",
            "Seconds to compile the plain image's kernel against spheres and lights added.",
        )
    )
    grown = [row | {"kind": key} for key in ("spheres", "lights") for row in groups[key]]
    _powers(folder / "compile.png", grown, "added", "compile_s", "seconds to compile")
    drawn.append(("memory.png", "The most memory of a process that renders one image."))
    _powers(folder / "memory.png", groups["memory"], "pixels", "mib", "MiB")
    return drawn


def _advice(rows: Rows) -> list[tuple[float, str]]:
    """For each level of error that is reached the fastest setting."""
    advice = []
    for level in LEVELS:
        good = [row for row in rows if "ms" in row and row["error"] <= level]
        if good:
            best = min(good, key=lambda row: row["ms"])
            advice.append((level, f"{best['name']}: {best['ms']:.3g} ms"))
    return advice


def _errors(path: Path, rows: Rows, best: Rows, label: str) -> None:
    """Error against time on logarithmic scales, by kind, with the Pareto front and the reference's
    own error.
    """
    figure, axes = figure_of(1, 6)
    for kind in dict.fromkeys(row["kind"] for row in rows if "ms" in row):
        own = sorted(
            (row for row in rows if row["kind"] == kind and "ms" in row), key=lambda row: row["ms"]
        )
        times, spreads = [row["ms"] for row in own], [row["spread"] for row in own]
        axes.errorbar(
            times, [row["error"] for row in own], xerr=spreads, fmt="o-", ms=4, label=kind
        )
        for row in own:
            text, place = row["name"].removeprefix(f"{kind}, "), (row["ms"], row["error"])
            axes.annotate(
                text, place, fontsize=6, rotation=40, xytext=(2, 3), textcoords="offset points"
            )
    if best:
        axes.plot(
            [row["ms"] for row in best],
            [row["error"] for row in best],
            "k:",
            lw=1,
            label="no setting is better in both",
        )
    for row in rows:
        if row["kind"] == "floor":
            axes.axhline(row["error"], color="0.6", lw=1, label=row["name"])
    _finish(figure, axes, path, "milliseconds", label)


def _powers(path: Path, rows: Rows, across: str, key: str, label: str) -> None:
    figure, axes = figure_of(1, 5)
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        axes.plot(
            [row["x"] for row in own], [max(row[key], 1e-3) for row in own], "o-", ms=4, label=kind
        )
    _finish(figure, axes, path, across, label)


def _finish(figure: Any, axes: Any, path: Path, across: str, up: str) -> None:
    axes.set(xscale="log", yscale="log", xlabel=across, ylabel=up)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7)
    atomically(path, lambda temporary: figure.savefig(temporary, dpi=110))


def report(
    name: str, facts: Mapping[str, Any], groups: Mapping[str, Rows], drawn: list[tuple[str, str]]
) -> str:
    """The page."""
    about = "".join(
        f"<tr><th>{html.escape(key)}</th><td>{html.escape(str(value))}</td></tr>"
        for key, value in facts.items()
    )
    plots = "".join(
        f'<h2>{html.escape(text)}</h2><img src="{file}" alt="">' for file, text in drawn
    )
    best = front([*groups["image"], *groups["depth"], *groups["importance"]])
    rows = "".join(
        f"<tr><td>{row['name']}</td><td>{row['ms']:.2f}</td><td>{row['error']:.5f}</td></tr>"
        for row in best
    )
    style = "body{font-family:sans-serif;max-width:60em;margin:auto} h2{font-size:1em} th{text-align:left} img{max-width:100%}"
    return (
        f"<!DOCTYPE html><html lang='en'><meta charset='utf-8'><title>{html.escape(name)}</title><style>{style}</style>"
        f"<h1>{html.escape(name)}: speed against accuracy</h1><p>Times are medians of whole calls with compiled kernels, "
        "taken in turns; bars are half the range between quartiles. Errors are relative to plain samples in double precision.</p>"
        f"<table>{about}</table><h2>Settings that none is better than in both time and error</h2>"
        f"<table><tr><th>setting</th><th>ms</th><th>error</th></tr>{rows}</table>{plots}</html>"
    )


def _table(rows: Rows) -> str:
    text = io.StringIO()
    names = list(dict.fromkeys(key for row in rows for key in row))
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
