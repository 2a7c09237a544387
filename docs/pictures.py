"""The pictures of the documentation, drawn of code at each build."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

import whitted as wt

LIGHT, ORANGE, GREY = "#b9cfe8", "#e39458", "#8a8a8a"
# The schematic edge: a part of a circle
CENTER, RADIUS = np.array([-1.3, -1.7]), 4.32


def draw_all(folder: Path) -> None:
    """Write all pictures."""
    for name, draw in PICTURES.items():
        draw().savefig(folder / f"{name}.png", dpi=130, facecolor="white")


def _inside(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return (x - CENTER[0]) ** 2 + (y - CENTER[1]) ** 2 < RADIUS**2


def _axes(figure: Figure, place: tuple[int, int, int], title: str):
    axes = figure.add_subplot(*place)
    axes.set(xlim=(0, 4), ylim=(0, 4), aspect="equal", xticks=[], yticks=[])
    axes.set_title(title, fontsize=10)
    return axes


def _samples() -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(np.arange(4) + 0.5, np.arange(4) + 0.5)


def _dots(axes, x: np.ndarray, y: np.ndarray) -> None:
    """Samples: filled within the edge, empty outside of it."""
    inside = _inside(x, y)
    axes.plot(x[inside], y[inside], "o", color="black", ms=6)
    axes.plot(x[~inside], y[~inside], "o", mfc="white", mec="black", ms=6)


def moving_edge() -> Figure:
    """An edge moves between samples, and none of them changes."""
    figure = Figure(figsize=(7.2, 3.7), layout="constrained")
    x, y = _samples()
    for k, (title, shift) in enumerate([("before", 0.0), ("after", 0.065)]):
        axes = _axes(figure, (1, 2, k + 1), title)
        axes.add_patch(Circle(CENTER + [shift, 0], RADIUS, color=ORANGE, lw=0))
        axes.add_patch(Circle(CENTER, RADIUS, color=LIGHT, lw=0))
        for line in range(1, 4):
            axes.axhline(line, color=GREY, lw=0.6)
            axes.axvline(line, color=GREY, lw=0.6)
        _dots(axes, x, y)
    return figure


def crossings() -> Figure:
    """Where an edge crosses the segments between samples, and how the areas are counted."""
    figure = Figure(figsize=(7.2, 3.7), layout="constrained")
    x, y = _samples()
    inside = _inside(x, y)
    axes = _axes(figure, (1, 2, 1), "labels differ: an edge in between")
    axes.add_patch(Circle(CENTER, RADIUS, color=LIGHT, lw=0))
    for j in range(4):
        for i in range(4):
            for dx, dy in ((1, 0), (0, 1)):
                a, b = (i, j), (i + dx, j + dy)
                if max(b) > 3 or inside[a[1], a[0]] == inside[b[1], b[0]]:
                    continue
                p, q = np.array(a) + 0.5, np.array(b) + 0.5
                axes.plot(*zip(p, q, strict=True), color=GREY, lw=1.5)
                ends = np.linspace(p, q, 400)
                crossing = ends[np.argmin(abs(np.hypot(*(ends - CENTER).T) - RADIUS))]
                axes.plot(*crossing, "x", color=ORANGE, ms=8, mew=2.5)
    _dots(axes, x, y)

    axes = figure.add_subplot(1, 2, 2)
    axes.set(xlim=(-0.75, 1.75), ylim=(-0.8, 1.05), aspect="equal")
    axes.set_axis_off()
    axes.set_title("one segment", fontsize=10)
    c = 0.68
    axes.add_patch(Rectangle((-0.5, -0.5), c + 0.5, 1, color=LIGHT, lw=0))
    axes.add_patch(Rectangle((0.5, -0.5), c - 0.5, 1, color=ORANGE, lw=0))
    for left in (-0.5, 0.5):
        axes.add_patch(Rectangle((left, -0.5), 1, 1, fill=False, ec="black", lw=1.2))
    axes.plot([0, 1], [0, 0], color=GREY, lw=1.5)
    axes.plot(0, 0, "o", color="black", ms=7)
    axes.plot(1, 0, "o", mfc="white", mec="black", ms=7)
    axes.plot(c, 0, "x", color="black", ms=9, mew=2.5)
    axes.annotate("", (c + 0.25, 0.3), (c, 0.3), arrowprops={"arrowstyle": "->", "lw": 1.5})
    axes.text(c + 0.28, 0.27, "$v$", fontsize=12)
    axes.text(-0.05, 0.1, "$f_-$", fontsize=12, ha="right")
    axes.text(1.08, -0.2, "$f_+$", fontsize=12)
    axes.text(0.5, -0.65, "border", ha="center", fontsize=9)
    axes.text(c, -0.16, "$c$", fontsize=12, ha="left")
    axes.text(0.5, 0.62, "counted for the wrong sample", ha="center", fontsize=9, color="#a4541a")
    return figure


def derivatives() -> Figure:
    """The Cornell box by a position of its glass ball: both terms, and differences."""
    scene = wt.load_scene("cornell")
    name, step = "spheres.ball.center", 5e-3
    options = {"spp": 4, "resolution": (128, 128)}
    middle = scene.parameters(name)[name].numpy().ravel()
    ahead, behind = (
        wt.render(scene.replace({name: middle + [side * step, 0, 0]}), 16, resolution=(128, 128))
        for side in (1, -1)
    )
    shown = {
        "interior term": wt.gradient(scene, name, "x", terms="interior", **options),
        "boundary term": wt.gradient(scene, name, "x", terms="boundary", **options),
        "both": wt.gradient(scene, name, "x", **options),
        "differences of images": (ahead - behind) / (2 * step),
    }
    figure = Figure(figsize=(9.6, 2.6), layout="constrained")
    for k, (title, image) in enumerate(shown.items()):
        axes = figure.add_subplot(1, len(shown), k + 1)
        axes.imshow(image.numpy()[62:, 38:106].mean(2), cmap="seismic", vmin=-3, vmax=3)
        axes.set_title(title, fontsize=9)
        axes.set_axis_off()
    return figure


PICTURES = {
    "moving-edge": moving_edge,
    "crossings": crossings,
    "derivatives": derivatives,
}
