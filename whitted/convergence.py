"""How a fit goes on: a progress bar while it does, a plot afterwards."""

import itertools
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np


class Step(Protocol):
    """An iteration of a fit."""

    iteration: int
    resolution: tuple[int, int]
    loss: float
    x: np.ndarray


@contextmanager
def progress_bar(labels: Sequence[str]) -> Iterator[Callable[[Any], None]]:
    """A callback for iterations, which shows them on standard error if that is a terminal."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}")
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("fit", total=None)

        def show(step: Step) -> None:
            numbers = "  ".join(f"{label} {value:.5g}" for label, value in zip(labels[:6], step.x, strict=False))
            width, height = step.resolution
            bar.update(task, description=f"iteration {step.iteration}, {width} x {height}, loss {step.loss:.3e}  {numbers}")

        yield show


def plot(history: Sequence[Any], labels: Sequence[str], path: str | None) -> Any:
    """Draw the loss and every number over the iterations.

    Raises:
        RuntimeError: there is no matplotlib.
    """
    figure, axes = figure_of(2)
    steps = [step.iteration for step in history]
    axes[0].semilogy(steps, [step.loss for step in history], "k.-")
    axes[0].set_ylabel("loss")
    for k, label in enumerate(labels):
        values = np.array([step.x[k] for step in history])
        axes[1].plot(steps, values - values[-1], ".-", label=f"{label} - {values[-1]:.5g}")
    axes[1].set_yscale("symlog", linthresh=1e-4)
    axes[1].set_ylabel("less its last value")
    axes[1].legend(fontsize=8)
    # Where the resolution changes
    for before, after in itertools.pairwise(history):
        if before.resolution != after.resolution:
            for panel in axes:
                panel.axvline(after.iteration - 0.5, color="0.8", zorder=0)
    axes[1].set_xlabel("iteration")
    if path is not None:
        figure.savefig(path, dpi=110)
    return figure


def figure_of(rows: int, height: float = 3) -> tuple[Any, Any]:
    """An empty matplotlib figure with panels of some inches' height below each other, drawn without a display.

    Raises:
        RuntimeError: there is no matplotlib.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise RuntimeError("plots need matplotlib, which is missing; install it with: pip install 'whitted[fit]'") from None
    figure = Figure(figsize=(8, height * rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, 1, sharex=True)
