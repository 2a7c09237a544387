"""Errors of derivatives with edges: python benchmarks/gradients.py [--scene NAME] [--parameter
REGEX]

The forward derivative by every parameter at 16 samples a pixel, in double precision, against
central differences of images with edges at 441 (whitted1980: 36), and of plain samples at 8192 to
2097152 points in a pixel where those are not enough. Each error is written into docs/gradients.csv
when it is measured, in place of an older one, and docs/gradients.png shows what is there (needs the
`bench` extra). All scenes take some hours.
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

FOLDER = Path(__file__).parent.parent / "docs"
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
)
COLUMNS += ("bound", "spp 1", "spp 4")
# Samples a pixel of a reference (not 64, which have the same finer grid as 16), and parts of the
# step, of which the surest is taken; of a scene where these take minutes fewer
REFERENCE, FEWER = (441, (1.0, 0.3)), {"whitted1980": (36, (1.0, 0.1))}
# Where that is too coarse to tell whether a derivative is right, so many pixels are sampled anew,
# plainly: at so many points until the error is known well enough, with more points fewer of them
POINTS = {1 << 13: 1500, 1 << 18: 500, 1 << 21: 40}
# Parts of the step there, each a quarter of the one before; and twice the lattices' steps, squared
STEPS, LATTICES = (16.0, 4.0, 1.0, 1 / 4, 1 / 16, 1 / 64), (2, 3, 5, 7, 11, 13, 17, 19)
# Where the sum of the derivative's image is farther from the reference's, that is found with larger
# steps as well
SUM, LARGER = 0.02, (4.0, 16.0, 64.0)
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

    return wt.render(scene, spp, resolution=(128, 128)).numpy()


class Derivative:
    """The derivative of a scene's image by one parameter along one direction, exact and by
    differences.

    Args:
        still: from samples a pixel to the scene's image.
    """

    def __init__(self, scene, name: str, still: Callable[[int], np.ndarray]) -> None:
        self.scene, self.name, self.still = scene, name, still
        self.value = np.asarray(scene.parameters(name)[name]).ravel()
        direction = np.random.default_rng(zlib.crc32(name.encode())).normal(size=len(self.value))
        self.direction = direction / np.linalg.norm(direction) if len(direction) > 1 else np.ones(1)
        self.step = {"fov": 1e-2, "ior": 1e-3}.get(name.rpartition(".")[2], 1e-4)

    def exact(self, spp: int) -> np.ndarray:
        import drjit as dr

        import whitted as wt

        # All parameters that the scene uses, so that they share their kernels
        values = dr.detach(self.scene.parameters(*{self.name, *self.scene.nonzero}))
        dr.enable_grad(values)
        for name, value in values.items():
            dr.set_grad(
                value,
                type(value)(*self.direction.tolist())
                if name == self.name
                else dr.zeros(type(value)),
            )
        image = wt.render(self.scene.replace(values), spp, resolution=(128, 128))
        return dr.forward_to(image).numpy()

    def moved(self, spp: int, factor: float) -> np.ndarray:
        """The image where the parameter is moved by a multiple of the step."""
        return image(
            self.scene.replace({self.name: self.value + factor * self.step * self.direction}), spp
        )

    def differences(self, spp: int, factor: float) -> tuple[np.ndarray, np.ndarray]:
        """Central differences, and forward ones. How far they are apart is the larger part of the
        central ones' error.
        """
        forward, back, h = self.moved(spp, factor), self.moved(spp, -factor), factor * self.step
        return (forward - back) / (2 * h), (forward - self.still(spp)) / h

    def total(self, spp: int, near: float, far: float) -> tuple[float, float]:
        """The sum of the derivative's image of the surest step, from those of two steps on, and how
        far from the next's.
        """
        found = [near]
        for factor in LARGER:
            found.append(
                (self.moved(spp, factor) - self.moved(spp, -factor)).sum()
                / (2 * factor * self.step)
            )
        pairs = [(near, abs(far - near)), *((b, abs(b - a)) for a, b in pairwise(found))]
        return min(pairs, key=lambda pair: pair[1])

    @cached_property
    def plain(self):
        """A function from a part of the step to the differences of plain samples in a pixel, and
        how unsure they are, twice.

        They are on some lattices, each of which sees edges well but those along its own directions.
        Their scatter tells the noise, which is at least what two points make that an edge passes.
        The other error is that of the step: as edges pass a part of the pixel, that part of what
        they change may be new or gone.
        """
        import drjit as dr
        from drjit.llvm import ad
        from whitted.trace import Limits

        from whitted import probe

        size, scene = ad.Array2f64(128, 128), self.scene
        limits = Limits(
            scene.max_depth,
            ad.UInt32(scene.max_depth),
            ad.Float64(scene.min_importance),
            ad.Float64(1),
        )

        @lru_cache
        def moved(factor: float) -> tuple:
            there = scene.replace({self.name: self.value + factor * self.step * self.direction})
            values = there.parameters()
            dr.make_opaque(values)
            return there.shape, values

        def differences(
            factor: float, x: int, y: int, points: int
        ) -> tuple[np.ndarray, float, float]:
            lattice, place = np.divmod(np.arange(points), points // len(LATTICES))
            across = (place + (lattice + 0.5) / len(LATTICES)) / (points // len(LATTICES))
            along = (place * np.sqrt(LATTICES)[lattice] / 2) % 1
            at = ad.Float64(x + across), ad.Float64(y + along)
            dr.make_opaque(size, limits, at)
            ahead, back = (
                probe.samples(*moved(sign * factor), size, limits, *at)[0] for sign in (1, -1)
            )
            colors = np.stack([channel.numpy() for channel in (*ahead, *back)])
            change, seen, width = (
                colors[:3] - colors[3:],
                np.ptp(colors[:3], 1),
                2 * factor * self.step,
            )
            slopes = change.reshape(3, len(LATTICES), -1).mean(2) / width
            noise = slopes.std(1) * (2 / len(LATTICES) ** 0.5), seen / (factor * self.step * points)
            passed = abs(change).mean(1) ** 2 / np.maximum(seen, 1e-9) / width
            return (
                slopes.mean(1),
                max(np.linalg.norm(each) for each in noise),
                np.linalg.norm(passed),
            )

        return differences

    def pixel(
        self, x: int, y: int, enough: float, points: Sequence[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Plain differences in one pixel, of the surest step and the least points with an error
        below `enough`, and with it.

        A step's error is its noise, or its own, of which there is no more than how far its value is
        from that of the step before, or how far that is from one of a smaller step by more than
        twice that one's noise. With more points only those steps are tried whose noise may get
        small enough to tell.
        """
        steps = STEPS
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
        return values[best], values[best] + errors[best] / 3**0.5

    @property
    def bound(self) -> float:
        """Relative error that is allowed: more for what is seen in, or through, a mirror or glass."""
        kind, _, rest = self.name.partition(".")
        shiny = {
            m.name
            for m in self.scene.materials
            if m.reflection.numpy()[0] > 0 or m.refraction.numpy()[0] > 0
        }
        owner = rest.partition(".")[0]
        if kind in ("spheres", "planes"):
            owner = next(item.material for item in getattr(self.scene, kind) if item.name == owner)
        return 0.1 if kind == "camera" or owner in shiny or self.name.endswith(".ior") else 0.05


def measure(derivative: Derivative, spp: int, factors: Sequence[float]) -> dict:
    """The error of one derivative.

    Central differences are compared, and those forward tell the reference's own error. Where it is
    not below a third of the bound, or the derivative's not below half, pixels where these differ
    most have differences of their own.
    """
    row = {"exact": derivative.exact(1), "bound": derivative.bound, "refined": 0}
    if not row["exact"].any() and not derivative.differences(1, 1)[0].any():
        return row
    exact, bound = derivative.exact(16), row["bound"]
    near, far = min(
        (derivative.differences(spp, factor) for factor in factors),
        key=lambda pair: relative(*pair[::-1]),
    )
    if relative(exact, near) > bound / 2 or relative(far, near) > bound / 3:
        doubt = np.sqrt(np.maximum(((exact - near) ** 2).sum(2), ((far - near) ** 2).sum(2)))
        small = bound / 200 * np.linalg.norm(near)
        for rank, place in enumerate(np.argsort(doubt.ravel())[: -max(POINTS.values()) - 1 : -1]):
            y, x = divmod(int(place), doubt.shape[1])
            if doubt[y, x] < small:
                break
            value, other = derivative.pixel(
                x, y, small, [number for number, most in POINTS.items() if rank < most]
            )
            error, claimed = np.linalg.norm(other - value), np.linalg.norm(far[y, x] - near[y, x])
            # Surer, or so far from it that the images agree by chance
            if error < claimed or np.linalg.norm(near[y, x] - value) > 5 * error + claimed:
                near[y, x], far[y, x] = value, other
                row["refined"] += 1
    row["uncertain"] = relative(far, near)
    total, unsure = near.sum(), abs(far.sum() - near.sum())
    if abs(exact.sum() - total) > SUM * abs(total):
        total, unsure = derivative.total(spp, total, far.sum())
    sums = [
        abs(exact.sum() - total) / abs(total),
        unsure / abs(total),
        abs(exact.sum() - total) / np.abs(near).sum(),
    ]
    return row | {"exact": exact, "reference": near, "error": relative(exact, near), "sums": sums}


def described(name: str, row: dict) -> str:
    """A line of the table."""
    if "error" not in row:
        return f"{name:32}no effect, largest |J| {np.abs(row['exact']).max():.1e}"
    verdict = "pass" if row["error"] <= row["bound"] else "FAIL"
    mark = " (reference uncertain)" if row["uncertain"] > row["bound"] / 3 else ""
    errors, sums = (
        f"{row['error']:9.5f}{row['uncertain']:11.5f}",
        "".join(f"{error:10.5f}" for error in row["sums"]),
    )
    return f"{name:32}{errors}{row['refined']:>9}{sums}{row['bound']:7.2f}  {verdict}{mark}"


def worst(row: dict) -> Iterator[str]:
    """The pixels with the largest errors, and their share of its square."""
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
    """Put a derivative's errors into the file."""
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
    """Measure a scene's derivatives, and say in a line how many pass."""
    import whitted as wt

    scene = wt.load_scene(SCENES / f"{name}.toml", "double")
    rows, kinds, start, still = (
        {},
        list(KINDS),
        time.perf_counter(),
        lru_cache(partial(image, scene)),
    )
    print(f"{name}, 128 x 128, spp 16: relative L2 error", flush=True)
    print(
        f"{'parameter':32}{'error':>9}{'reference':>11}{'refined':>9}{'of sum':>10}{'reference':>10}{'/ sum||':>10}{'bound':>7}"
    )
    for parameter in scene.parameters():
        if not re.search(only, parameter):
            continue
        derivative = Derivative(scene, parameter, still)
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
            print(
                "    spp 1, 4:" + "".join(f"{e:9.5f}" for e in errors) + f", slope {steep:.2f}",
                flush=True,
            )
        record(name, parameter, row, errors)
    found = {parameter: row for parameter, row in rows.items() if "error" in row}
    failed = [parameter for parameter, row in found.items() if row["error"] > row["bound"]]
    most = max(
        found,
        key=lambda parameter: found[parameter]["error"] / found[parameter]["bound"],
        default="none",
    )
    error = f"worst {most} {found[most]['error']:.4f}, " if found else ""
    text = f"{name:20}{len(found) - len(failed)} of {len(found)} pass, {error}{len(rows) - len(found)} without effect"
    text += "".join(
        f"\n    FAIL {parameter} {found[parameter]['error']:.4f}" for parameter in failed
    )
    print(f"{text}\n{time.perf_counter() - start:.0f} s\n", flush=True)
    return text


def draw() -> None:
    """Errors against samples a pixel, for a parameter of each kind of each scene."""
    rows = [row for row in table().values() if row["spp 1"]]
    names = sorted({row["scene"] for row in rows})
    figure, axes = panels(names)
    for row in rows:
        errors = [float(row[column]) for column in ("spp 1", "spp 4", "error")]
        axes[row["scene"]].plot(
            BOUNDARY, errors, "o-", label=f"{row['parameter']}, slope {slope(BOUNDARY, errors):.2f}"
        )
    for panel in axes.values():
        panel.legend(fontsize=7)
    axes[names[0]].set_ylabel("relative L2 error")
    save(figure, FOLDER / "gradients.png")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--scene", action="append", help="only this scene of the folder scenes; may be repeated"
    )
    parser.add_argument(
        "--parameter", default="", help="only parameters in whose names this regular expression is"
    )
    arguments = parser.parse_args()
    names = arguments.scene or sorted(path.stem for path in SCENES.glob("*.toml"))
    texts = [gradients(name, arguments.parameter) for name in names]
    draw()
    print("\n".join(texts))


if __name__ == "__main__":
    main()
