"""The time of one call, which several benchmarks take."""

import time
from collections.abc import Callable


def milliseconds(call: Callable[[], object]) -> float:
    """Milliseconds of a call, until the last of its kernels has ended."""
    import drjit as dr

    dr.sync_thread()
    start = time.perf_counter()
    dr.eval(call())
    dr.sync_thread()
    return (time.perf_counter() - start) * 1e3
