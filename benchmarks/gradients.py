"""Measure the errors of derivatives with edges.

    python benchmarks/gradients.py [--scene NAME] [--parameter REGEX]

Measured is the forward derivative by every parameter, at 16 samples a pixel in double precision.
The reference is central differences of images with edges at 441 samples a pixel (whitted1980: 36).
Where these are too coarse to tell whether a derivative is right, pixels get differences of plain
samples instead, at 8192 to 2097152 points in the pixel.

Each error is written to results/gradients.csv as soon as it is measured, in place of an older
one. results/gradients.png shows what that file holds (needs the `bench` extra). All scenes take
some hours.
"""

import argparse
import csv
import re
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from boundary import BOUNDARY, SCENES, panels, relative, save, slope

FOLDER = Path(__file__).parent.parent / "results"
TABLE = FOLDER / "gradients.csv"
COLUMNS = (
    "scene",
    "parameter",
    "error",
    "of the reference",
    "refined pixels",
    "of sum",
    "of the reference's sum",
    "of moduli",
    "bound",
    "spp 1",
    "spp 4",
)
RESOLUTION = (128, 128)
# The step by which parameters are moved, along a random direction: by the last part of their names,
# and for all others
STEPS, STEP = {"fov": 1e-2, "ior": 1e-3}, 1e-4
# Samples a pixel of the reference, and multiples of the step, of which the most certain is taken.
# 64 samples would not do: they have the same finer grid as 16.
REFERENCE = (441, (1.0, 0.3))
# The same for scenes where that takes minutes for one parameter
FEWER = {"whitted1980": (36, (1.0, 0.1))}
# Plain samples in a pixel, and how many pixels get so many at most. A pixel gets more of them until
# its error is small enough.
POINTS = {1 << 13: 1500, 1 << 18: 500, 1 << 21: 40}
# Multiples of the step of plain samples, each a quarter of the one before
PLAIN_STEPS = (16.0, 4.0, 1.0, 1 / 4, 1 / 16, 1 / 64)
# Plain samples lie on several lattices; from one point of a lattice to the next, y grows by half
# the square root of a prime
LATTICES = (2, 3, 5, 7, 11, 13, 17, 19)
# Where the derivative, summed over the image, is off by more than this part of the reference's sum,
# that sum is measured by these multiples of the step as well. The largest is 0.0064 where a range
# is closed, less than the 0.01 by which `Scene.replace` lets a number leave such a range.
SUM, SUM_STEPS = 0.02, (4.0, 16.0, 64.0)
# What the names of parameters of one kind have in common. The first of each kind in a scene is
# measured at fewer samples as well.
KINDS = (
    "center",
    "radius",
    "normal",
    "offset",
    "color",
    "ior",
    "lights.",
    "camera.position",
    "fov",
)


def image(scene, spp: int) -> np.ndarray:
    import whitted as wt

    return wt.render(scene, spp, resolution=RESOLUTION).numpy()


class Derivative:
    """The derivative of a scene's image by one parameter: exact, and by differences.

    Args:
        unmoved: a function from samples a pixel to the scene's image.
    """

    def __init__(self, scene, name: str, unmoved: Callable[[int], np.ndarray]) -> None:
        self.scene, self.name, self.unmoved = scene, name, unmoved
        self.value = np.asarray(scene.parameters(name)[name]).ravel()
        direction = np.random.default_rng(zlib.crc32(name.encode())).normal(size=len(self.value))
        self.direction = direction / np.linalg.norm(direction) if len(direction) > 1 else np.ones(1)
        self.step = STEPS.get(name.rpartition(".")[2], STEP)

    def exact(self, spp: int) -> np.ndarray:
        """The derivative along the parameter's direction, in forward mode."""
        import drjit as dr

        import whitted as wt

        # With all parameters that the kernels have compiled in, so that many derivatives share one
        values = dr.detach(self.scene.parameters(*{self.name, *self.scene.features.live}))
        dr.enable_grad(values)
        for name, value in values.items():
            along = self.direction.tolist() if name == self.name else [0]
            dr.set_grad(value, type(value)(*along))
        image = wt.render(self.scene.replace(values), spp, resolution=RESOLUTION)
        return dr.forward_to(image).numpy()

    def scene_at(self, factor: float):
        """The scene with the parameter moved by a multiple of the step."""
        return self.scene.replace({self.name: self.value + factor * self.step * self.direction})

    def differences(self, spp: int, factor: float) -> tuple[np.ndarray, np.ndarray]:
        """Central differences and forward ones, of a multiple of the step.

        How far they are apart tells the error of the central ones.
        """
        ahead, back = (image(self.scene_at(sign * factor), spp) for sign in (1, -1))
        h = factor * self.step
        return (ahead - back) / (2 * h), (ahead - self.unmoved(spp)) / h

    def total(self, spp: int, central: float, forward: float) -> tuple[float, float]:
        """The sum of the derivative over the image, of the most certain step, and its uncertainty.

        A step's uncertainty is how far its sum is from that of the step before. For the first step
        it is how far central and forward differences, which are given, are apart.
        """
        sums = [central]
        for factor in SUM_STEPS:
            ahead, back = (image(self.scene_at(sign * factor), spp) for sign in (1, -1))
            sums.append((ahead - back).sum() / (2 * factor * self.step))
        certain = [(central, abs(forward - central))]
        certain += [(total, abs(total - before)) for before, total in pairwise(sums)]
        return min(certain, key=lambda pair: pair[1])

    @cached_property
    def plain(self):
        """A function from a multiple of the step to differences of plain samples in a pixel.

        The samples are on several lattices. Each lattice sees edges well, but for those along its
        own directions. The function returns the slope and two errors. The first is noise: the
        scatter of the lattices' slopes, or the slope that two points make when an edge passes them,
        whichever is larger. The second is the step's own error: the edges sweep over a part of the
        pixel, and that part of the change may not be theirs at the parameter's value.
        """
        import drjit as dr
        from drjit.llvm import ad

        from whitted.core.host import to_lanes
        from whitted.edges.kernels import labelled_samples
        from whitted.tracing.node import Limits

        size, scene = ad.Array2f64(*RESOLUTION), self.scene
        limits = Limits(
            scene.max_depth,
            ad.UInt32(scene.max_depth),
            ad.Float64(scene.min_importance),
            ad.Float64(1),
        )

        @lru_cache
        def moved(factor: float) -> tuple:
            there = self.scene_at(factor)
            values = there.inputs()
            dr.make_opaque(values)
            return there.structure, values

        def differences(
            factor: float, x: int, y: int, points: int
        ) -> tuple[np.ndarray, float, float]:
            lattice, place = np.divmod(np.arange(points), points // len(LATTICES))
            across = (place + (lattice + 0.5) / len(LATTICES)) / (points // len(LATTICES))
            along = (place * np.sqrt(LATTICES)[lattice] / 2) % 1
            at = to_lanes(x + across), to_lanes(y + along)
            bright = ad.Bool(False)
            dr.make_opaque(size, limits, at, bright)
            ahead, back = (
                labelled_samples(*moved(sign * factor), size, limits, *at, bright)[0]
                for sign in (1, -1)
            )
            colors = np.stack([channel.numpy() for channel in (*ahead, *back)])
            change, seen = colors[:3] - colors[3:], np.ptp(colors[:3], 1)
            width = 2 * factor * self.step
            slopes = change.reshape(3, len(LATTICES), -1).mean(2) / width
            scatter = slopes.std(1) * (2 / len(LATTICES) ** 0.5)
            two_points = seen / (factor * self.step * points)
            passed = abs(change).mean(1) ** 2 / np.maximum(seen, 1e-9) / width
            noise = max(np.linalg.norm(scatter), np.linalg.norm(two_points))
            return slopes.mean(1), noise, np.linalg.norm(passed)

        return differences

    def pixel(
        self, x: int, y: int, enough: float, points: Sequence[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """The derivative of one pixel by plain differences, and the same with its error added.

        It is taken with the first number of points that brings an error below `enough`, at the
        most certain step. A step's error is its noise or its own error, whichever is larger. Its
        own error is at most the distance to the derivative of the step before. It is at least the
        distance to that of a smaller step, less twice the noise of that one. With more points only
        those steps are tried whose noise may get small enough.
        """
        steps = PLAIN_STEPS
        for number, following in pairwise([*points, points[-1]]):
            values, noise, passed = zip(
                *(self.plain(step, x, y, number) for step in steps), strict=True
            )
            errors = []
            for k, value in enumerate(values):
                before = np.linalg.norm(value - values[k - 1]) if k else np.inf
                apart = [
                    np.linalg.norm(value - values[j]) - 2 * noise[j]
                    for j in range(k + 1, len(values))
                ]
                errors.append(max(noise[k], min(passed[k], before), *apart))
            best = int(np.argmin(errors))
            if errors[best] < enough:
                break
            quieter = (following / number) ** 0.75
            steps = [
                step
                for step, each in zip(steps, noise, strict=True)
                if each < 3 * quieter * errors[best]
            ]
        # The error's norm is over three channels
        return values[best], values[best] + errors[best] / 3**0.5

    @property
    def bound(self) -> float:
        """The relative error that is allowed.

        It is larger for the camera, for indices of refraction, and for mirrors, glass and what is
        made of them.
        """
        group, _, rest = self.name.partition(".")
        owner = rest.partition(".")[0]
        materials = {(shape.group, shape.name): shape.material for shape in self.scene.shapes}
        material_name = materials.get((group, owner), owner)
        shiny = {
            material.name
            for material in self.scene.materials
            if material.reflection.numpy()[0] > 0 or material.refraction.numpy()[0] > 0
        }
        hard = group == "camera" or material_name in shiny or self.name.endswith(".ior")
        return 0.1 if hard else 0.05


def measure(derivative: Derivative, spp: int, factors: Sequence[float]) -> dict:
    """The error of one derivative, and what is known of the reference.

    The reference is central differences. How far forward differences are from these tells the
    reference's own error. If that is more than a third of the bound, or the derivative's error more
    than half of it, those pixels that are most in doubt are measured again by plain samples.
    """
    row = {"exact": derivative.exact(1), "bound": derivative.bound, "refined": 0}
    if not row["exact"].any() and not derivative.differences(1, 1)[0].any():
        return row
    exact, bound = derivative.exact(16), row["bound"]
    central, forward = min(
        (derivative.differences(spp, factor) for factor in factors),
        key=lambda pair: relative(pair[1], pair[0]),
    )
    if relative(exact, central) > bound / 2 or relative(forward, central) > bound / 3:
        refine(row, derivative, exact, central, forward)
    row["uncertain"] = relative(forward, central)
    total, uncertain = central.sum(), abs(forward.sum() - central.sum())
    if abs(exact.sum() - total) > SUM * abs(total):
        total, uncertain = derivative.total(spp, total, forward.sum())
    off = abs(exact.sum() - total)
    sums = [off / abs(total), uncertain / abs(total), off / np.abs(central).sum()]
    error = relative(exact, central)
    return row | {"exact": exact, "reference": central, "error": error, "sums": sums}


def refine(
    row: dict,
    derivative: Derivative,
    exact: np.ndarray,
    central: np.ndarray,
    forward: np.ndarray,
) -> None:
    """Put plain differences in place of the pixels most in doubt, and count them in the row."""
    doubt = np.sqrt(np.maximum(((exact - central) ** 2).sum(2), ((forward - central) ** 2).sum(2)))
    small = row["bound"] / 200 * np.linalg.norm(central)
    for rank, place in enumerate(np.argsort(doubt.ravel())[: -max(POINTS.values()) - 1 : -1]):
        y, x = divmod(int(place), doubt.shape[1])
        if doubt[y, x] < small:
            break
        points = [number for number, most in POINTS.items() if rank < most]
        value, other = derivative.pixel(x, y, small, points)
        error = np.linalg.norm(other - value)
        claimed = np.linalg.norm(forward[y, x] - central[y, x])
        # They are more certain, or so far off that central and forward differences agree by chance
        if error < claimed or np.linalg.norm(central[y, x] - value) > 5 * error + claimed:
            central[y, x], forward[y, x] = value, other
            row["refined"] += 1


def header() -> str:
    """The line above those of `described`."""
    errors = f"{'error':>9}{'reference':>11}{'refined':>9}"
    sums = f"{'of sum':>10}{'reference':>10}{'of moduli':>10}"
    return f"{'parameter':32}{errors}{sums}{'bound':>7}"


def described(name: str, row: dict) -> str:
    """A parameter's errors in one line."""
    if "error" not in row:
        return f"{name:32}no effect, largest |J| {np.abs(row['exact']).max():.1e}"
    verdict = "pass" if row["error"] <= row["bound"] else "FAIL"
    mark = " (reference uncertain)" if row["uncertain"] > row["bound"] / 3 else ""
    errors = f"{row['error']:9.5f}{row['uncertain']:11.5f}{row['refined']:>9}"
    sums = "".join(f"{error:10.5f}" for error in row["sums"])
    return f"{name:32}{errors}{sums}{row['bound']:7.2f}  {verdict}{mark}"


def worst(row: dict) -> Iterator[str]:
    """The five pixels with the largest errors, and their parts of the square of the error."""
    squares = ((row["exact"] - row["reference"]) ** 2).sum(2)
    for place in np.argsort(squares.ravel())[:-6:-1]:
        y, x = divmod(int(place), squares.shape[1])
        values = ", ".join(
            f"{kind} {np.array2string(row[kind][y, x], precision=4)}"
            for kind in ("exact", "reference")
        )
        yield f"    pixel x {x}, y {y}: {100 * squares[y, x] / squares.sum():5.1f} %   {values}"


def table() -> dict[tuple[str, str], dict]:
    """The rows of the file, by scene and parameter."""
    if not TABLE.exists():
        return {}
    with TABLE.open(newline="") as file:
        return {(row["scene"], row["parameter"]): row for row in csv.DictReader(file)}


def record(scene: str, parameter: str, row: dict, errors: list[float]) -> None:
    """Write a derivative's errors to the file.

    Args:
        errors: those at 1 and at 4 samples a pixel, or none.
    """
    values = dict.fromkeys(COLUMNS, "") | {
        "scene": scene,
        "parameter": parameter,
        "bound": row["bound"],
    }
    if "error" in row:
        numbers = dict(
            zip(("of sum", "of the reference's sum", "of moduli"), row["sums"], strict=True)
        )
        numbers |= {"error": row["error"], "of the reference": row["uncertain"]}
        numbers |= dict(zip(("spp 1", "spp 4"), errors, strict=False))
        values |= {name: f"{number:.5f}" for name, number in numbers.items()}
        values["refined pixels"] = row["refined"]
    rows = table() | {(scene, parameter): values}
    temporary = TABLE.with_suffix(".tmp")
    with temporary.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows[key] for key in sorted(rows))
    temporary.replace(TABLE)


def gradients(name: str, only: str) -> str:
    """Measure a scene's derivatives, and say in a line how many pass.

    Args:
        only: a regular expression, for parameters in whose names it is found.
    """
    import whitted as wt

    start, scene = time.perf_counter(), wt.load_scene(SCENES / f"{name}.toml", "double")
    rows, kinds, unmoved = {}, list(KINDS), lru_cache(partial(image, scene))
    print(f"{name}, {RESOLUTION[0]} x {RESOLUTION[1]}, spp 16: relative L2 error", flush=True)
    print(header())
    for parameter in scene.parameters():
        if not re.search(only, parameter):
            continue
        derivative = Derivative(scene, parameter, unmoved)
        row = rows[parameter] = measure(derivative, *FEWER.get(name, REFERENCE))
        print(described(parameter, row), flush=True)
        kind = next((kind for kind in kinds if kind in parameter), None)
        errors = []
        if "error" in row and row["error"] > row["bound"]:
            print(*worst(row), sep="\n", flush=True)
        if "error" in row and kind is not None:
            kinds.remove(kind)
            errors = [relative(derivative.exact(spp), row["reference"]) for spp in BOUNDARY[:2]]
            steep = slope(BOUNDARY, [*errors, row["error"]])
            printed = "".join(f"{error:9.5f}" for error in errors)
            print(f"    spp 1, 4:{printed}, slope {steep:.2f}", flush=True)
        record(name, parameter, row, errors)
    text = summary(name, rows)
    print(f"{text}\n{time.perf_counter() - start:.0f} s\n", flush=True)
    return text


def summary(scene: str, rows: dict[str, dict]) -> str:
    """How many of a scene's derivatives pass, the worst one, and a line for each that fails."""
    found = {parameter: row for parameter, row in rows.items() if "error" in row}
    failed = [parameter for parameter, row in found.items() if row["error"] > row["bound"]]
    text = f"{scene:20}{len(found) - len(failed)} of {len(found)} pass, "
    if found:
        most = max(found, key=lambda name: found[name]["error"] / found[name]["bound"])
        text += f"worst {most} {found[most]['error']:.4f}, "
    text += f"{len(rows) - len(found)} without effect"
    return "\n".join([text, *(f"    FAIL {name} {found[name]['error']:.4f}" for name in failed)])


def draw() -> None:
    """Plot errors against samples a pixel, for a parameter of each kind of each scene."""
    rows = [row for row in table().values() if row["spp 1"]]
    names = sorted({row["scene"] for row in rows})
    figure, axes = panels(names)
    for row in rows:
        errors = [float(row[column]) for column in ("spp 1", "spp 4", "error")]
        label = f"{row['parameter']}, slope {slope(BOUNDARY, errors):.2f}"
        axes[row["scene"]].plot(BOUNDARY, errors, "o-", label=label)
    for panel in axes.values():
        panel.legend(fontsize=7)
    axes[names[0]].set_ylabel("relative L2 error")
    save(figure, FOLDER / "gradients.png")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--scene",
        action="append",
        metavar="NAME",
        help="measure only this scene of the folder scenes; may be repeated",
    )
    parser.add_argument(
        "--parameter",
        default="",
        metavar="REGEX",
        help="measure only parameters in whose names this regular expression is found",
    )
    arguments = parser.parse_args()
    names = arguments.scene or sorted(path.stem for path in SCENES.glob("*.toml"))
    texts = [gradients(name, arguments.parameter) for name in names]
    draw()
    print("\n".join(texts))


if __name__ == "__main__":
    main()
