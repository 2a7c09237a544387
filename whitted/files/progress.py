"""A progress bar on standard error."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# A callback for the fraction done, in (0, 1]
Report = Callable[[float], None]
# Seconds until a bar appears: what is over by then needs none
DELAY = 0.25


@contextmanager
def progress_bar(title: str) -> Iterator[Report]:
    """A callback for the fraction done, which shows a bar on standard error.

    The bar appears within a second, and only if standard error is a terminal. It pulses until the
    first report, as while kernels are compiled.
    """
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    bar = Progress(console=console, transient=True)
    task = bar.add_task(title, total=None)
    timer = threading.Timer(DELAY, bar.start)
    timer.daemon = True
    if console.is_terminal:
        timer.start()
    try:
        # Derivatives of an image may come after it: a bar that has stopped draws nothing
        yield lambda fraction: bar.update(task, total=1.0, completed=fraction)
    finally:
        timer.cancel()
        if timer.ident is not None:
            timer.join()
        if bar.live.is_started:
            bar.stop()


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
