"""The iterations of a fit: a progress bar while they last, and a plot afterwards."""

import itertools
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..files.figures import figure_of, legend_below

# Numbers that the legend of a plot names, at most
LABELLED = 16


@dataclass(frozen=True)
class Iteration:
    """The numbers that an iteration of a fit has led to, and their loss.

    The fit at each resolution, from each start, begins with one that has made no step: its loss is
    at another resolution, or of another start, and `iteration` is that of the one before.
    """

    iteration: int  # steps taken so far
    resolution: tuple[int, int]  # of the first view
    loss: float
    x: np.ndarray  # all numbers that are fitted
    attempt: int = 0  # of the fit, after its first descent: the number of a further try


@contextmanager
def progress_bar(labels: Sequence[str]) -> Iterator[Callable[[Iteration], None]]:
    """A callback that shows iterations on standard error, if that is a terminal."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}")
    hidden = not sys.stderr.isatty()
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=hidden) as bar:
        task = bar.add_task("fit", total=None)

        def show(step: Iteration) -> None:
            numbers = "  ".join(
                f"{label} {value:.5g}" for label, value in zip(labels[:6], step.x, strict=False)
            )
            where = f"iteration {step.iteration}, {step.resolution[0]} x {step.resolution[1]}"
            where += f", try {step.attempt}" if step.attempt else ""
            bar.update(task, description=f"{where}, loss {step.loss:.3e}  {numbers}")

        yield show


def plot(history: Sequence[Iteration], labels: Sequence[str], path: str | None) -> Any:
    """Draw the loss and every number over the iterations.

    Args:
        path: a file to write, by its ending.

    Returns:
        The matplotlib figure.

    Raises:
        RuntimeError: there is no matplotlib.
    """
    figure, (losses, numbers) = figure_of(2)
    steps = [step.iteration for step in history]
    losses.semilogy(steps, [step.loss for step in history], "k.-")
    losses.set_ylabel("loss (radiance squared)")
    for k, label in enumerate(labels):
        values = np.array([step.x[k] for step in history])
        told = f"{label} - {values[-1]:.5g}" if k < LABELLED else "_"
        numbers.plot(steps, values - values[-1], ".-", label=told)
    if len(labels) > LABELLED:
        numbers.plot([], [], " ", label=f"and {len(labels) - LABELLED} more")
    numbers.set_yscale("symlog", linthresh=1e-4)
    numbers.set_ylabel("parameter less its last value\n(its own unit)")
    legend_below(figure)
    numbers.set_xlabel("iteration")
    # Where the resolution changes
    for before, after in itertools.pairwise(history):
        if before.resolution != after.resolution:
            for panel in (losses, numbers):
                panel.axvline(after.iteration, color="0.8", zorder=0)
    if path is not None:
        figure.savefig(path)
    return figure
