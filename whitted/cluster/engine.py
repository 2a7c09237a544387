"""A run of many tasks, on this machine or on the workers of a Dask cluster.

The scheduler gets few tasks at a time, so that a run of millions takes no more of its memory than a
run of hundreds. What they share is a task, too: its result goes from worker to worker, and Dask
makes it anew where all workers that had it have died.
"""

import secrets
import time
import warnings
from collections import Counter
from collections.abc import Generator, Iterable, Iterator
from itertools import islice
from typing import Any

from .work import (
    ATTEMPTS,
    Function,
    Outcome,
    Packed,
    at_the_third_attempt,
    perform,
    same,
    stops,
    told,
)

# Tasks for each thread of the workers that are with the scheduler at once: the one that runs, and
# those that come next. Fewer leave workers idle for the way to here and back
AHEAD = 3
# Seconds after which the threads of all workers are counted again
RECOUNT = 2.0
# Results that are fetched at once, at most; a band of a picture has some MiB
TOGETHER = 16
GONE = "the scheduler has gone"


def outcomes(
    client: Any, function: Function, shared: Any, tasks: Iterable[Any]
) -> Generator[Outcome, None, None]:
    """Do tasks, and tell how each has ended, in any order.

    Args:
        client: a `distributed.Client`, or None for this process.
        function: of a module, called with `shared` and a task.
        tasks: that can be hashed, each once.

    Raises:
        OSError: a disk is full, or cannot be written to.
        ConnectionError: the scheduler has gone.
    """
    packed = Packed.of(shared)
    if client is None:
        for task in tasks:
            yield at_the_third_attempt(function, packed, task)
    else:
        # Imported late: without a client Dask is not needed
        from .connect import check_client, prepare_workers

        check_client(client)
        run = None
        try:
            prepare_workers(client)
            run = _Run(client, function, packed, iter(tasks))
            yield from run.outcomes()
        except OSError as error:
            # Those of Dask's connections have no number
            if stops(error):
                raise
            raise ConnectionError(GONE) from None
        finally:
            if run is not None:
                run.cancel()


class _Run:
    """A run on a cluster."""

    def __init__(
        self, client: Any, function: Function, packed: Packed, tasks: Iterator[Any]
    ) -> None:
        from distributed import as_completed

        self.client, self.function, self.tasks = client, function, tasks
        self.name = f"{function.__name__}-{secrets.token_hex(4)}"
        with warnings.catch_warnings():
            # A scene of many spheres is large, and is sent once
            warnings.filterwarnings("ignore", "Sending large graph")
            self.packed = client.submit(same, packed, key=f"shared-{self.name}")
        self.running: dict[Any, Any] = {}  # tasks by their futures
        self.failures: Counter[Any] = Counter()
        self.submitted = 0
        self.completed = as_completed()
        self.room, self.counted = 0, 0.0

    def outcomes(self) -> Iterator[Outcome]:
        # One worker of each machine compiles the kernels; the others then find them on its disk
        machines = self._one_worker_of_each_machine()
        for worker in machines:
            self._submit_next(1, [worker])
        if not machines:
            self._submit_next(1)
        compiling = len(self.running)
        for ended in self.completed.batches():
            for first in range(0, len(ended), TOGETHER):
                for outcome in self._outcomes(ended[first : first + TOGETHER]):
                    compiling -= 1
                    yield outcome
            if compiling <= 0:
                self._submit_next(self._room() - len(self.running))

    def _submit_next(self, count: int, workers: list[str] | None = None) -> None:
        """Submit the next tasks, as far as there are some."""
        self._submit(list(islice(self.tasks, max(0, count))), workers)

    def _submit(self, tasks: list[Any], workers: list[str] | None = None) -> None:
        if not tasks:
            return
        first, self.submitted = self.submitted, self.submitted + len(tasks)
        # Each goes alone to a worker; they come to the scheduler together
        futures = self.client.map(
            perform,
            tasks,
            key=[f"{self.name}-{number}" for number in range(first, self.submitted)],
            workers=workers,
            allow_other_workers=bool(workers),
            function=self.function,
            packed=self.packed,
        )
        self.running.update(zip(futures, tasks, strict=True))
        self.completed.update(futures)

    def _outcomes(self, futures: list[Any]) -> Iterator[Outcome]:
        """How tasks have ended, without those that are tried again."""
        good = [future for future in futures if future.status == "finished"]
        values = iter(self.client.gather(good))
        for future in futures:
            task = self.running.pop(future)
            if future in good:
                yield Outcome(task, next(values))
            elif future.status == "error":
                yield from self._failed(task, future.exception())
            else:
                raise ConnectionError(GONE)

    def _failed(self, task: Any, error: BaseException) -> Iterator[Outcome]:
        """How a task has ended that has failed; nothing if it is tried again."""
        from distributed import KilledWorker

        if stops(error):
            raise error
        if isinstance(error, KilledWorker):
            # Dask has tried it several times
            died = "each worker that ran it has died, perhaps for want of memory"
            yield Outcome(task, error=died)
            return
        self.failures[task] += 1
        if self.failures[task] < ATTEMPTS:
            self._submit([task])
        else:
            yield Outcome(task, error=told(error))

    def _room(self) -> int:
        """How many tasks may be with the scheduler."""
        now = time.monotonic()
        if not self.room or now - self.counted > RECOUNT:
            self.room = max(2, AHEAD * sum(self.client.nthreads().values()))
            self.counted = now
        return self.room

    def _one_worker_of_each_machine(self) -> list[str]:
        workers = self.client.nthreads()
        return list({worker.rpartition(":")[0]: worker for worker in workers}.values())

    def cancel(self) -> None:
        """Give up what still runs."""
        if self.running and self.client.status == "running":
            self.client.cancel(list(self.running))
        self.running.clear()
