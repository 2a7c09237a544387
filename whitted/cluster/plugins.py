"""What is set on workers when they start, and again when Dask starts them again."""

import os
import signal
from typing import Any

import drjit as dr
from distributed import WorkerPlugin


class Threads(WorkerPlugin):
    """Gives Dr.Jit as many threads as Dask was told that the worker has.

    Without this, each worker of a machine would have as many threads as the machine has cores.
    """

    name = "whitted-threads"

    def __init__(self, client: int) -> None:
        self.client = client  # its process, whose threads are the user's

    def setup(self, worker: Any) -> None:
        if os.getpid() != self.client:
            dr.set_thread_count(worker.state.nthreads)


class OwnInterrupts(WorkerPlugin):
    """Leaves Ctrl-C to the process that has started the worker: a terminal sends it to all."""

    name = "whitted-interrupts"

    def setup(self, worker: Any) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
