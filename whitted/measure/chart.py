"""A report of a scene's speed against its accuracy."""

import csv
import hashlib
import io
import platform
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ..files.atomic import write_text
from ..files.figures import figure_of
from ..files.pages import page_template
from ..files.writable import check_folder
from .about import compiled_in, system
from .analysis import front
from .experiments import EXPERIMENTS
from .plots import FILES, Plot, draw_plots, image_settings
from .setup import Setup
from .store import Rows, Store

# The files of a report
NAMES = ("measured.json", "report.html", *FILES, *(f"{name}.csv" for name in EXPERIMENTS))


def chart(
    scene: Path,
    folder: Path,
    release: str,
    *,
    size: tuple[int, int] | None = None,
    quick: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Path:
    """Measure a scene and write a report: a page, plots, a CSV of each group, and all as JSON.

    Measurements that the folder has of the same conditions are kept, so that an interrupted run
    can be resumed.

    Args:
        scene: a scene file.
        folder: is made if it does not exist.
        release: the version of this package, for the report.
        size: width and height, in pixels, of the images whose errors are measured [default: 192 x
            192, or 96 x 96 if quick].
        quick: fewer samples, rounds and sizes.
        progress: called after each group of measurements with the fraction done, in (0, 1].

    Returns:
        The page, report.html.

    Raises:
        ValueError: the folder, or one of the files in it, cannot be written to; or images of the
            size are out of range, or do not fit in memory.
        SceneError: the scene file is not valid.
        RuntimeError: matplotlib or Jinja2 is not installed.
        OSError: a file cannot be written.
    """
    check_folder(folder, NAMES)
    require_libraries()
    setup = Setup(scene, size or ((96, 96) if quick else (192, 192)), quick)
    folder.mkdir(exist_ok=True)
    facts = conditions(setup, release)
    store = Store(folder / "measured.json", facts)
    groups: dict[str, Rows] = {}
    for name, measure in EXPERIMENTS.items():
        groups[name] = store.group(name, partial(measure, setup))
        write_text(folder / f"{name}.csv", _csv(groups[name]))
        if progress is not None:
            progress(len(groups) / len(EXPERIMENTS))
    plots = draw_plots(folder, groups, setup.parameter_label)
    page = folder / "report.html"
    write_text(page, report(scene.stem, facts, groups, plots))
    return page


def require_libraries() -> None:
    """Find out that a library is missing before the measurements, not after them.

    Raises:
        RuntimeError: matplotlib or Jinja2 is not installed.
    """
    figure_of(1)
    page_template(__package__, "chart.html")


def conditions(setup: Setup, release: str) -> dict[str, Any]:
    """What the measurements depend on."""
    facts = system()
    return {
        "scene": setup.path.name,
        "scene SHA-256": hashlib.sha256(setup.single.text.encode()).hexdigest(),
        "image": "{} x {}".format(*setup.size),
        "compiled in": compiled_in(setup.single),
        "quick": setup.quick,
        "machine": platform.processor() or platform.machine(),
        "threads": facts["threads"],
        "vector width": facts["vector width"],
        "Dr.Jit": facts["Dr.Jit"],
        "libLLVM": Path(facts["libLLVM"].split(" ")[0]).name,
        "Python": platform.python_version(),
        "whitted": release,
    }


def report(
    name: str, facts: Mapping[str, Any], groups: Mapping[str, Rows], plots: Sequence[Plot]
) -> str:
    """The page as HTML.

    Args:
        name: of the scene.
        facts: what the measurements depend on.
        groups: the measurements by the name of their experiment.
    """
    best = front(image_settings(groups))
    template = page_template(__package__, "chart.html")
    return template.render(name=name, conditions=facts, best=best, plots=plots)


def _csv(rows: Rows) -> str:
    """Measurements as CSV, with a column for each key that any of them has."""
    text = io.StringIO()
    names = list(dict.fromkeys(key for row in rows for key in row))
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
