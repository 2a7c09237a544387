"""What measurements say: the best settings, and how time grows."""

import numpy as np

from .store import Rows

# Errors of the image for which the report names the fastest setting
ERRORS = (0.05, 0.02, 0.01, 0.005)


def front(rows: Rows) -> Rows:
    """The measurements that no other beats in both time and error, the fastest first."""
    timed = [row for row in rows if "ms" in row]
    best: Rows = []
    for row in sorted(timed, key=lambda row: (row["ms"], row["error"])):
        if not best or row["error"] < best[-1]["error"]:
            best.append(row)
    return best


def fastest(rows: Rows) -> list[tuple[float, dict]]:
    """For each of `ERRORS` that is reached, it and the fastest measurement that reaches it."""
    found = []
    for error in ERRORS:
        good = [row for row in rows if "ms" in row and row["error"] <= error]
        if good:
            found.append((error, min(good, key=lambda row: row["ms"])))
    return found


def slope(rows: Rows) -> float:
    """The exponent e of a time that grows like x^e, NaN for fewer than two measurements.

    It is fitted to the larger half of four measurements or more, where fixed costs matter little.
    """
    ordered = sorted(rows, key=lambda row: row["x"])
    large = ordered[len(ordered) // 2 :] if len(ordered) > 3 else ordered
    if len(large) < 2:
        return float("nan")
    x, ms = ([row[key] for row in large] for key in ("x", "ms"))
    return float(np.polyfit(np.log(x), np.log(ms), 1)[0])
