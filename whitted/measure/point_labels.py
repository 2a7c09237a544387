"""Labels of a plot's points that cover neither points nor each other."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

# Distances of a label from its point that are tried, in pixels; directions at each; and half the
# width of a point
DISTANCES, DIRECTIONS, POINT = (8, 16, 28, 42, 60, 80, 105), 12, 4.0


def label_points(
    figure: Any, axes: Any, points: Sequence[tuple[float, float]], notes: Sequence[str]
) -> None:
    """Write a note near each point, with a thin line to it, where there is room.

    A point without room nearby gets none. Call this when all else is drawn.

    Args:
        points: x and y in the units of the axes.
        notes: one for each.
    """
    # The layout is settled by drawing; later text must not move it
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    renderer = figure.canvas.get_renderer()
    places = axes.transData.transform(np.array(points, dtype=np.float64).reshape(-1, 2))
    taken = [_box(place, 2 * POINT, 2 * POINT) for place in places]
    frame = axes.get_window_extent(renderer).extents
    to_fraction = figure.transFigure.inverted().transform
    for point, place, note in zip(points, places, notes, strict=True):
        style: dict[str, Any] = {"fontsize": 6.5, "ha": "center", "va": "center"}
        text = axes.annotate(
            note,
            point,
            xytext=to_fraction(place),
            textcoords="figure fraction",
            arrowprops={"arrowstyle": "-", "lw": 0.4, "color": "0.5", "shrinkA": 0, "shrinkB": 2},
            **style,
        )
        extent = text.get_window_extent(renderer)
        for center in _around(place, extent.width, extent.height):
            box = _box(center, extent.width + 2, extent.height + 2)
            if _within(box, frame) and not any(_overlap(box, other) for other in taken):
                text.set_position(to_fraction(center))
                taken.append(box)
                break
        else:
            text.remove()


def _around(place: np.ndarray, width: float, height: float) -> Iterator[np.ndarray]:
    """Centers of a label around a point, the nearest first, to the upper right first."""
    angles = np.pi / 4 + 2 * np.pi / DIRECTIONS * np.arange(DIRECTIONS)
    for distance in DISTANCES:
        for way in np.stack([np.cos(angles), np.sin(angles)], 1):
            yield place + way * (distance + np.array([width, height]) / 2)


def _box(center: np.ndarray, width: float, height: float) -> np.ndarray:
    """Left, lower, right and upper end."""
    half = np.array([width, height]) / 2
    return np.concatenate([center - half, center + half])


def _overlap(a: np.ndarray, b: np.ndarray) -> bool:
    return bool((a[:2] < b[2:]).all() and (b[:2] < a[2:]).all())


def _within(a: np.ndarray, b: np.ndarray) -> bool:
    return bool((a[:2] >= b[:2]).all() and (a[2:] <= b[2:]).all())
