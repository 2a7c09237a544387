"""What work on a cluster costs beside the pictures, with workers on this machine.

    .venv/bin/python benchmarks/cluster.py tasks        tasks that do nothing: the scheduler's rate
    .venv/bin/python benchmarks/cluster.py chunks       how fast chunks are written to a store
    .venv/bin/python benchmarks/cluster.py pictures     pictures of 128 x 128: here, one worker with
                                                        all threads, workers of one thread each
    .venv/bin/python benchmarks/cluster.py overhead     the same pictures by one thread here, and by
                                                        one worker of one thread, in turns

About 15 s, 10 s, two minutes and two minutes on two cores. `docs/cluster.md` has the figures, and
what follows from them for a thousand workers.
"""

import operator
import os
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

import drjit as dr

import whitted as wt
from whitted import cluster
from whitted.cluster import store
from whitted.cluster.connect import connected
from whitted.cluster.dataset import Asked, planned_sweep
from whitted.cluster.engine import outcomes

CORES = os.cpu_count() or 1
# Tasks that do nothing, chunks that are written, and pictures that are rendered
TASKS, CHUNKS, PICTURES = 1000, 200, 1024
ROUNDS = 3
VARY = {"materials.glass.ior": (1.3, 1.8), "spheres.ball.center.x": (-0.2, 0.2)}


def tasks() -> None:
    """The time of a task that does nothing, with 2 workers."""
    with connected(None, 2) as client:
        rounds = []
        for _ in range(ROUNDS):
            start = time.perf_counter()
            assert sum(1 for _ in outcomes(client, operator.is_, None, range(TASKS))) == TASKS
            rounds.append(time.perf_counter() - start)
    seconds = statistics.median(rounds)
    print(f"{TASKS} tasks: {1e3 * seconds / TASKS:.2f} ms each, {TASKS / seconds:.0f} a second")


def chunks() -> None:
    """The time of a chunk of 16 pictures of 128 x 128, and its mark, from one process."""
    folder = Path(tempfile.mkdtemp())
    try:
        asked = Asked(16 * CHUNKS, "sobol", 0, 1, True, None, (128, 128), [], 16)
        sweep = planned_sweep(wt.load_scene("cornell"), VARY, folder / "a.zarr", asked)
        store.create(sweep.path, sweep.plan)
        image = wt.render(sweep.plan.scene, resolution=(128, 128)).numpy()
        block = image[None].repeat(16, 0)
        rounds = []
        for task in range(CHUNKS):
            start = time.perf_counter()
            store.write(sweep.path, sweep.plan, task, {store.IMAGE: block})
            rounds.append(time.perf_counter() - start)
    finally:
        shutil.rmtree(folder)
    seconds = statistics.median(rounds)
    size = block.nbytes / (1 << 20)
    rate = f"{1e3 * seconds:.1f} ms each, {size / seconds:.0f} MiB/s"
    print(f"{CHUNKS} chunks of {size:.1f} MiB: {rate}")


def pictures() -> None:
    """The time of a picture of 128 x 128 with edges: here, and on workers."""
    here = seconds_of(None)
    print(f"here, {CORES} threads: {1e3 * here:.2f} ms a picture")
    for workers in (1, CORES):
        with connected(None, workers) as client:
            seconds = seconds_of(client)
        threads = CORES // workers
        print(
            f"{workers} workers of {threads} threads: {1e3 * seconds:.2f} ms a picture, "
            f"{100 * (seconds / here - 1):+.1f} %"
        )


def overhead() -> None:
    """What a worker of one thread takes beside what one thread here takes, in turns."""
    from distributed import Client, LocalCluster

    dr.set_thread_count(1)
    alone: list[float] = []
    worker: list[float] = []
    about = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(**about) as local, Client(local) as client:
        for _ in range(2):
            alone.append(seconds_of(None))
            worker.append(seconds_of(client))
    dr.set_thread_count(CORES)
    here, there = min(alone), min(worker)
    print(f"one thread here: {1e3 * here:.2f} ms a picture")
    print(f"one worker of one thread: {1e3 * there:.2f} ms, {100 * (there / here - 1):+.1f} %")


def seconds_of(client: object) -> float:
    """The time of a picture, when all kernels are there."""
    scene, folder, rounds = wt.load_scene("cornell"), Path(tempfile.mkdtemp()), []
    try:
        for k in range(2):
            start = time.perf_counter()
            path = folder / f"{k}.zarr"
            cluster.sweep(scene, VARY, path, client, count=PICTURES, resolution=(128, 128))
            rounds.append((time.perf_counter() - start) / PICTURES)
    finally:
        shutil.rmtree(folder)
    # The first has compiled
    return min(rounds[1:])


if __name__ == "__main__":
    names = sys.argv[1:] or ["tasks", "chunks", "pictures", "overhead"]
    for name in names:
        {"tasks": tasks, "chunks": chunks, "pictures": pictures, "overhead": overhead}[name]()
