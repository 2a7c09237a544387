"""Error against time of images: by samples, by `max_depth`, by `min_importance`."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from ..core.arrays import Array
from .setup import Setup, relative_error
from .store import Rows


def image(setup: Setup) -> Rows:
    """Plain samples and samples with edges, in both precisions."""
    plain = (1, 4, 16, 64) if setup.quick else (1, 4, 16, 64, 256)
    settings = [
        ("plain", setup.single, plain, False),
        ("boundary", setup.single, (1, 4, 16), True),
        ("plain, float64", setup.double, (1, 16), False),
        ("boundary, float64", setup.double, (1, 4), True),
    ]
    calls, labels = {}, []
    for kind, scene, counts, boundary in settings:
        for spp in counts:
            calls[f"{kind}, spp {spp}"] = partial(setup.render, scene, spp, boundary=boundary)
            labels.append({"kind": kind, "spp": spp})
    rows = [row | label for row, label in zip(_errors(setup, calls), labels, strict=True)]
    # An accurate image by other samples differs from the reference by about the reference's error
    other = setup.render(setup.double, 36 if setup.quick else 64).numpy()
    error = relative_error(other, setup.reference)
    return [*rows, {"kind": "floor", "name": "error of the reference", "error": error}]


def depth(setup: Setup) -> Rows:
    """Shorter chains of rays."""
    depths = range(1, max(2, min(8, setup.single.max_depth)) + 1)
    calls = {
        f"boundary, spp 4, max_depth {d}": partial(setup.render, setup.single, 4, max_depth=d)
        for d in depths
    }
    return [row | {"depth": d} for row, d in zip(_errors(setup, calls), depths, strict=True)]


def importance(setup: Setup) -> Rows:
    """No rays of a low importance."""
    least = (0.0, 0.03, 0.1, 0.3)
    calls = {
        f"boundary, spp 4, min_importance {value:g}": partial(
            setup.render, replace(setup.single, min_importance=value), 4
        )
        for value in least
    }
    return [row | {"least": value} for row, value in zip(_errors(setup, calls), least, strict=True)]


def _errors(setup: Setup, calls: Mapping[str, Callable[[], Array]]) -> Rows:
    """Time calls that render images, and compare each image with the reference."""
    rows = setup.times(calls)
    for row in rows:
        row["error"] = relative_error(row.pop("value").numpy(), setup.reference)
    return rows
