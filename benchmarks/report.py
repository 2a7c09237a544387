"""Measure the three tables of the report that this project implements.

    python benchmarks/report.py [-o DIR]

The tables are times by depth, by resolution and by material. Each time is printed beside ours.
The report's renderer ran on an Intel i7-3610M, ours runs on this machine: in single precision, with
one sample a pixel. Ours is the median of several whole calls, once all kernels are compiled;
compile time is told apart. Writes report.csv and report.png (needs the `bench` extra).
"""

import argparse
import csv
import math
import os
import platform
import statistics
import tempfile
import time
from pathlib import Path

SCENES = Path(__file__).parent.parent / "scenes"
# The report's seconds by depth, by width in pixels and by material
DEPTHS = {1: 16, 5: 16, 10: 16, 20: 16}
SIZES = {100: 1, 300: 6, 600: 25, 1000: 78, 1200: 122}
MATERIALS = {"diffuse": 16, "mirror": 17, "glass": 18, "mixed": 18}


def measure(scene: str, size: int, depth: int) -> tuple[float, float]:
    """Seconds to compile, and seconds of a call once all is compiled."""
    import drjit as dr

    import whitted as wt
    from whitted.measure.timing import recorded

    loaded = wt.load_scene(SCENES / f"three_{scene}.toml")

    def call() -> float:
        start = time.perf_counter()
        dr.eval(wt.render(loaded, boundary=False, max_depth=depth, resolution=(size, size)))
        dr.sync_thread()
        return time.perf_counter() - start

    with recorded() as first:
        call()
    return first.compile_seconds, statistics.median(call() for _ in range(15))


def rows() -> list[dict]:
    """One row a measurement, in the report's order."""
    cases = [("depth", depth, "mixed", 500, depth, seconds) for depth, seconds in DEPTHS.items()]
    cases += [("resolution", size, "mixed", size, 5, seconds) for size, seconds in SIZES.items()]
    cases += [("material", name, name, 500, 5, seconds) for name, seconds in MATERIALS.items()]
    table = []
    for name, value, scene, size, depth, seconds in cases:
        compiled, ours = measure(scene, size, depth)
        row = {
            "table": name,
            "value": value,
            "report_s": seconds,
            "ours_s": ours,
            "compile_s": compiled,
            "ratio": seconds / ours,
        }
        times = f"{seconds:10} s{ours:12.4f} s{compiled:10.2f} s{row['ratio']:10.0f} x"
        print(f"{name:12}{value!s:>8}{times}")
        table.append(row)
    return table


def plot(table: list[dict], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 3, figsize=(12, 3.8), constrained_layout=True, sharey=True)
    for panel, name in zip(panels, ("depth", "resolution", "material"), strict=True):
        here = [row for row in table if row["table"] == name]
        labels = [str(row["value"]) for row in here]
        panel.plot(labels, [row["report_s"] for row in here], "o-", label="the report (i7-3610M)")
        panel.plot(labels, [row["ours_s"] for row in here], "s-", label="whitted, warm")
        # A row that needed no new kernel has no compile time
        compiled = [row["compile_s"] if row["compile_s"] > 0.01 else math.nan for row in here]
        panel.plot(labels, compiled, "^:", color="gray", label="whitted, compile (once)")
        panel.set(title=name, yscale="log", ylim=(1e-4, 500))
        panel.grid(alpha=0.3)
    panels[0].set_ylabel("seconds")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.savefig(path, dpi=120)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("out"),
        help="folder for report.csv and report.png",
    )
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as cache:
        # An empty cache, so that compile times are of compiling and not of loading
        os.environ["DRJIT_CACHE_DIR"] = cache
        print(f"{platform.machine()}, {os.cpu_count()} cores")
        print("table          value   the report        ours    compile     ratio")
        table = rows()
    with (folder / "report.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    plot(table, folder / "report.png")
    print(f"wrote {folder / 'report.csv'} and {folder / 'report.png'}")


if __name__ == "__main__":
    main()
