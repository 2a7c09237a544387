"""The way to a scheduler and its workers."""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib import metadata
from typing import Any

from ..core.interrupts import heed, held
from .libraries import require
from .plan import PACKAGES

# Seconds in which a scheduler has to answer
TIMEOUT = 10
# Workers that a message names, at most
NAMED = 3


@contextmanager
def connected(scheduler: str | None, workers: int | None) -> Iterator[Any]:
    """A client of a scheduler, or of workers that are started on this machine; None without both.

    Args:
        scheduler: its address, such as 127.0.0.1:8786.
        workers: how many to start; each gets its part of this machine's cores.

    Raises:
        ValueError: both are given, no workers are to be started, or nothing answers.
        RuntimeError: Dask is missing.
    """
    if scheduler is not None and workers is not None:
        raise ValueError("scheduler: has workers of its own; leave out --workers, or --scheduler")
    if workers is not None and workers < 1:
        raise ValueError(f"workers: expected a whole number from 1 on, got {workers}")
    if scheduler is None and workers is None:
        yield None
        return
    require("distributed")
    with _client(scheduler) if scheduler is not None else _local(workers or 1) as client:
        yield client


@contextmanager
def _client(scheduler: str) -> Iterator[Any]:
    from distributed import Client

    # What goes wrong with the connection is told in one line
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    refused = f"scheduler: '{scheduler}' does not answer within {TIMEOUT} s"
    remedy = "start one with: dask scheduler"
    try:
        client = Client(scheduler, timeout=TIMEOUT)
    except Exception as error:
        # What answers may be no scheduler, and say anything
        raise ValueError(f"{refused}; {remedy}") from error
    with client:
        if not client.nthreads():
            # A queue may still have to start them
            told = f"waiting for workers; start some with: dask worker {scheduler}"
            print(told, file=sys.stderr, flush=True)
            client.wait_for_workers(1)
        yield client


@contextmanager
def _local(workers: int) -> Iterator[Any]:
    from distributed import Client, LocalCluster

    from .plugins import OwnInterrupts

    threads = max(1, (os.cpu_count() or 1) // workers)
    # A worker that dies is started again; the run goes on, and tells at its end what is missing
    for name in ("distributed", "distributed.nanny", "distributed.worker"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with ExitStack() as stack:

        def start() -> Any:
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=threads,
                processes=True,
                # Any free port: another cluster may have the usual one
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
            client = stack.enter_context(Client(stack.enter_context(cluster)))
            client.register_plugin(OwnInterrupts(), name=OwnInterrupts.name)
            return client

        # Ctrl-C waits until workers can be ended in good order
        heed()
        yield held(start)


def check_client(client: Any) -> None:
    """Refuse what is no client of a cluster, or is closed."""
    from distributed import Client

    if not isinstance(client, Client):
        kind = type(client).__name__
        raise TypeError(
            f"client: expected a distributed.Client, got {kind}; Client(cluster) or "
            "Client(address) makes one"
        )
    if client.status != "running":
        raise ValueError(f"client: is {client.status}; connect again")


def own_version(package: str) -> str:
    """The version of a package on this machine."""
    return metadata.version(package)


def prepare_workers(client: Any) -> None:
    """Check that all workers have the same versions as this machine, and set their threads.

    Raises:
        ValueError: a worker has another version of whitted or of Dr.Jit.
    """
    from .plugins import Threads

    check_versions(client)
    client.register_plugin(Threads(os.getpid()), name=Threads.name)


def check_versions(client: Any) -> None:
    """Refuse workers of other versions."""
    problems = []
    for package in PACKAGES:
        own = own_version(package)
        # A function of Python itself: it also runs where whitted is missing
        for worker, found in client.run(metadata.version, package, on_error="return").items():
            if found != own:
                has = f"has {package} {found}" if isinstance(found, str) else f"has no {package}"
                problems.append(f"worker {worker}: {has}, and this machine {own}")
    if problems:
        more = len(problems) - NAMED
        shown = problems[:NAMED] + ([f"{more} more"] if more > 0 else [])
        raise ValueError("; ".join(shown) + "; install the same versions everywhere")
