"""A fit in a process of its own, so that pictures do not wait for it."""

import math
import multiprocessing
import signal
import threading
import warnings
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from ..inverse.fit import fit
from ..inverse.result import FitResult
from ..scene.scene import Scene
from .sliders import sizes_of

Event = dict[str, Any]
Post = Callable[[Event], None]
# Samples a pixel of a fit's pictures, and of a target that is the picture as it is now
SPP = 4


class Fitting:
    """A fit that runs, and what it reports."""

    def __init__(self, scene: Scene, target: np.ndarray, options: Event, post: Post) -> None:
        """Start a fit.

        Args:
            scene: where to start.
            target: linear RGB of shape (height, width, 3).
            options: of `fit`.
            post: called from another thread with events: the keys "values" (names and numbers),
                "loss", "iteration" and "size" of an iteration; "values", "numbers", "summary" and
                "notes" of the end; "error" of a failure.
        """
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(
            target=_run, args=(theirs, scene, target, options), daemon=True
        )
        self._asked = False
        self._process.start()
        theirs.close()
        threading.Thread(target=self._listen, args=(post,), daemon=True).start()

    def stop(self) -> None:
        """Ask for the best so far; when asked again, end the process."""
        if self._asked:
            self.kill()
        self._asked = True
        try:
            self._ours.send("stop")
        except OSError:
            # It has just ended
            return

    def kill(self) -> None:
        """End the process."""
        self._process.kill()

    def _listen(self, post: Post) -> None:
        """Pass on what the process sends, until it ends."""
        last: Event = {}
        try:
            while not (last.keys() & {"summary", "error"}):
                last = self._ours.recv()
                post(last)
        except (EOFError, OSError):
            self._process.join()
            status = self._process.exitcode
            remedy = "the scene is that of the last step"
            post({"error": f"the process of the fit has ended (status {status}); {remedy}"})
        self._process.join()
        self._ours.close()


def _run(pipe: Connection, scene: Scene, target: np.ndarray, options: Event) -> None:
    """What the process does. Ctrl-C in the terminal is for the server, which ends this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sizes = sizes_of(scene)
    names = list(scene.parameters(*options["wrt"]))

    def report(step: Any) -> None:
        ends = np.cumsum([sizes[name] for name in names])[:-1]
        parts = [part.tolist() for part in np.split(step.x, ends)]
        values = dict(zip(names, parts, strict=True))
        told = {"loss": float(step.loss), "iteration": step.iteration, "size": step.resolution}
        pipe.send({"values": values, **told})
        if pipe.poll():
            raise KeyboardInterrupt

    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            result = fit(scene, target, progress=False, callback=report, **options)
        pipe.send(_end_of(result, [str(each.message) for each in warned]))
    except OSError:
        # There is no one to tell: the server has ended
        return
    except (ValueError, KeyError, TypeError, RuntimeError, MemoryError) as error:
        pipe.send({"error": str(error.args[0] if error.args else error)})


def _end_of(result: FitResult, warned: list[str]) -> Event:
    """What is told of a result; a deviation that is not known is None."""
    values = {name: np.ravel(value).tolist() for name, value in result.parameters.items()}
    numbers = [
        (label, value, deviation if math.isfinite(deviation) else None)
        for label, value, deviation in result.numbers()
    ]
    notes = [*result.notes, *warned]
    return {"values": values, "numbers": numbers, "summary": result.summary(), "notes": notes}
