"""A progress bar on standard error."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# A callback for the fraction done, in (0, 1]
Report = Callable[[float], None]


@contextmanager
def progress_bar(title: str) -> Iterator[Report]:
    """A callback for the fraction done, which shows a bar on standard error.

    The bar appears after a second, and only if standard error is a terminal.
    """
    from rich.console import Console
    from rich.progress import Progress

    start, over = time.monotonic(), False
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=True) as bar:
        task = bar.add_task(title, total=1.0)

        def report(fraction: float) -> None:
            # Derivatives of an image may come after it
            if over:
                return
            late = time.monotonic() - start > 1
            if bar.disable and console.is_terminal and late and fraction < 1:
                bar.disable = False
                bar.start()
            bar.update(task, completed=fraction)

        try:
            yield report
        finally:
            over = True


@contextmanager
def reporting(progress: Report | bool | None, title: str) -> Iterator[Report | None]:
    """What `progress` asks for: the caller's function, a bar for True, nothing for False or None.

    Raises:
        ValueError: it is something else.
    """
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise ValueError(
            f"progress: expected True, False or a function of the fraction done, got {progress!r}"
        )
    if progress is True:
        with progress_bar(title) as report:
            yield report
    else:
        yield progress if callable(progress) else None
