"""What Dr.Jit compiled and ran: kernel history, summed."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import drjit as dr


@dataclass
class Kernels:
    """All kernels that ran in a `recorded` block."""

    operations: int = 0  # of the largest kernel
    compile_seconds: float = 0.0  # generating and compiling code, or loading it from the cache
    run_seconds: float = 0.0
    compiled: int = 0  # kernels that were in no cache


@contextmanager
def recorded() -> Iterator[Kernels]:
    """Record the kernels of the block; the result is filled when it ends."""
    kernels = Kernels()
    dr.sync_thread()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        yield kernels
        dr.sync_thread()
        for entry in dr.kernel_history():
            kernels.run_seconds += entry["execution_time"] / 1e3
            kernels.compile_seconds += (
                entry.get("codegen_time", 0) + entry.get("backend_time", 0)
            ) / 1e3
            kernels.operations = max(kernels.operations, entry.get("operation_count", 0))
            kernels.compiled += "cache_hit" in entry and not entry["cache_hit"]
