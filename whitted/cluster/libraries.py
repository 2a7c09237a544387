"""Libraries of the extra `cluster`, which are imported where they are needed."""

import importlib
from typing import Any

WHAT = {
    "distributed": "a cluster",
    "zarr": "a Zarr store",
    "scipy.stats.qmc": "a Sobol sequence",
}


def require(module: str) -> Any:
    """A module of the extra.

    Raises:
        RuntimeError: it is missing; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        python = " on Python 3.11 or newer" if package == "zarr" else ""
        raise RuntimeError(
            f"{WHAT[module]} needs {package}: pip install 'whitted[cluster]'{python}"
        ) from error
