"""Measure other renderers beside this one, on the same scene in the same run.

    python benchmarks/peers/run.py [ROUNDS] [-o DIR] [--without NAME ...]

Each peer that is installed runs in a process of its own, with an empty cache. Its first image and
gradient are timed alone, for the compile time; then all take turns. Writes peers.md and peers.png
to results, or to DIR (needs the `bench` extra).
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from common import PROBES

HERE = Path(__file__).parent
OURS = "whitted, boundary=True"
PLAIN = "whitted, boundary=False"
KERNEL = "whitted, its kernels"
# The script of each peer in this folder, and its argument
PEERS = {
    PLAIN: ["ours.py", "plain"],
    OURS: ["ours.py", "boundary"],
    KERNEL: ["ours.py", "kernel"],
    "C++ by hand, AVX-512": ["simd_peer.py", "avx512"],
    "C++ by hand, AVX2": ["simd_peer.py", "avx2"],
    "C++, scalar": ["cpp.py"],
    "POV-Ray 3.7": ["pov.py"],
    "JAX": ["jax_peer.py"],
    "Taichi": ["taichi_peer.py"],
    "NumPy": ["numpy_peer.py"],
    "Mitsuba 3, Whitted": ["mitsuba_whitted.py"],
    "Mitsuba 3, path": ["mitsuba_paths.py", "path"],
    "Mitsuba 3, prb": ["mitsuba_paths.py", "prb"],
    "Mitsuba 3, prb_projective": ["mitsuba_paths.py", "prb_projective"],
}
NOTES = {
    PLAIN: "plain samples, and derivatives that miss what edges add",
    OURS: "edges found, and derivatives that are right at them",
    KERNEL: "the same as plain, but only the time that its kernels run, by Dr.Jit's own clock",
    "C++ by hand, AVX-512": "packets of 16 rays, two threads; all numbers of the scene are data",
    "C++ by hand, AVX2": "the same source with packets of 8 rays",
    "C++, scalar": "forward mode by dual numbers of 24 derivatives, two threads",
    "POV-Ray 3.7": "trace time that it prints, without parsing; no derivatives",
    "JAX": "generations of rays, packed into arrays of fixed sizes; `grad`",
    "Taichi": "scalar code for a pixel, a stack of rays, two threads; the image only",
    "NumPy": "generations of rays; no derivatives",
    "Mitsuba 3, Whitted": "the same work in Mitsuba's Python interface: "
    "generations of rays, its shapes, plain AD",
    "Mitsuba 3, path": "**other work**: 16 random paths a pixel, which go on between walls; "
    "Mitsuba's own materials",
    "Mitsuba 3, prb": "**other work**: the gradient of `path` by the position of one sphere, "
    "without edges",
    "Mitsuba 3, prb_projective": "**other work**: the same with edges, as far as it can see them",
}
# What our kernel is compared with
CODE = "C++ by hand, AVX-512", "C++ by hand, AVX2", "C++, scalar", "Taichi"
TIMED = ("image", "gradient")
# Calls that take more milliseconds than the first number are made as many times as the second
SLOW, TURNS = 1000, 3
# Milliseconds that a turn takes at least: short calls are repeated, as the first few find in the
# caches what other peers left
TURN = 50


class Worker:
    """A peer's process."""

    def __init__(self, name: str, cache: str) -> None:
        environment = {**os.environ, "DRJIT_CACHE_DIR": str(Path(cache) / name.replace(" ", "_"))}
        command = [sys.executable, str(HERE / PEERS[name][0]), *PEERS[name][1:]]
        self.name = name
        self.times: dict[str, list[float]] = {call: [] for call in TIMED}
        self.first: dict[str, float] = {}
        self.megabytes: dict[str, float] = {}
        self.sums: dict[str, float] = {}
        self.cannot: set[str] = set()
        self.compiled: float | None = None
        self.picture = Path(cache) / f"{name.replace(' ', '_')}.npy"
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            command, env=environment, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True
        )
        self.missing = self.read().get("missing")

    def read(self) -> dict:
        """The next answer, or why there is none."""
        line = self.process.stdout.readline()
        return (
            json.loads(line) if line else {"missing": f"stopped with status {self.process.wait()}"}
        )

    def ask(self, call: str, **more) -> dict:
        """The answer to a call; empty where the peer cannot make it."""
        if self.missing or call in self.cannot:
            return {}
        print(json.dumps({"call": call, **more}), file=self.process.stdin, flush=True)
        reply = self.read()
        self.missing = reply.get("missing")
        if "ms" not in reply:
            self.cannot.add(call)
            return {}
        return reply

    def begin(self) -> None:
        """Make the first calls, which compile."""
        for call in self.times:
            reply = self.ask(call)
            if reply:
                self.first[call], self.megabytes[call] = reply["ms"], reply["megabytes"]
                self.compiled = reply["compiled"]
        self.ask("image", path=str(self.picture))
        self.sums = self.ask("sums").get("result", {})

    def turn(self) -> None:
        """Make the calls of one round."""
        for call, times in self.times.items():
            if len(times) >= TURNS and statistics.median(times) > SLOW:
                continue
            spent = 0.0
            while spent < TURN and (reply := self.ask(call)):
                times.append(reply["ms"])
                spent += reply["ms"]
                self.megabytes[call] = max(self.megabytes[call], reply["megabytes"])

    def compile_seconds(self, call: str) -> float:
        """How much longer the first call took than later ones, or how long a compiler took."""
        if self.compiled is not None:
            return self.compiled
        return max(0.0, self.first[call] - statistics.median(self.times[call])) / 1e3

    def row(self) -> dict:
        """All that was measured of the peer."""
        row = {"name": self.name, "sums": self.sums}
        for call, times in self.times.items():
            if times:
                numbers = {
                    "median": statistics.median(times),
                    "fastest": min(times),
                    "megabytes": self.megabytes[call],
                }
                row[call] = numbers | {"compile": self.compile_seconds(call)}
        return row


def difference(picture: Path, ours: Path) -> dict:
    """How a picture differs from ours.

    Returns:
        The relative RMSE, the part of the pixels that are off by more than 0.01, and the relative
        RMSE of the others; nothing if there is no picture.
    """
    import numpy as np

    if not picture.exists():
        return {}
    a, b = np.load(picture), np.load(ours)
    off = abs(a - b).max(axis=2) > 0.01

    def error(which) -> float:
        return float(np.linalg.norm((a - b)[which]) / np.linalg.norm(b[which]))

    return {
        "rmse": error(np.ones_like(off)),
        "off": float(off.mean()),
        "rest": float("nan") if off.all() else error(~off),
    }


def measure(rounds: int, without: list[str]) -> tuple[list[dict], dict[str, str]]:
    """What was measured of each peer, and why peers are missing."""
    with tempfile.TemporaryDirectory() as cache:
        workers = []
        for name in [name for name in PEERS if name not in without]:
            worker = Worker(name, cache)
            worker.begin()
            print(f"{name}: {worker.missing or 'ready'}", flush=True)
            workers.append(worker)
        for _ in range(rounds):
            for worker in workers:
                worker.turn()
        rows = []
        for worker in workers:
            worker.process.stdin.close()
            worker.process.wait()
            if not worker.missing:
                differs = difference(worker.picture, workers[0].picture)
                rows.append(worker.row() | {"difference": differs})
        return rows, {worker.name: worker.missing for worker in workers if worker.missing}


def script(name: str) -> dict:
    """What another script of this folder prints."""
    done = subprocess.run([sys.executable, str(HERE / name)], capture_output=True, text=True)
    if done.returncode:
        return {"missing": f"{name} stopped with status {done.returncode}"}
    return json.loads(done.stdout)


def cell(row: dict, call: str, field: str, form: str) -> str:
    """A number of a call, or a dash where the peer cannot make the call."""
    return form.format(row[call][field]) if call in row else "-"


def speed_table(rows: list[dict]) -> list[str]:
    """Times, compile times and memory."""
    titles = ("image, ms", "fastest", "gradient, ms", "fastest", "compile, s: image", "gradient")
    titles += ("memory, MB: image", "gradient")
    lines = ["| | " + " | ".join(titles) + " |", "|---|" + "---:|" * len(titles)]
    for row in rows:
        cells = [
            cell(row, call, field, "{:.1f}") for call in TIMED for field in ("median", "fastest")
        ]
        cells += [cell(row, call, "compile", "{:.1f}") for call in TIMED]
        cells += [cell(row, call, "megabytes", "{:.0f}") for call in TIMED]
        lines.append(f"| {row['name']} | " + " | ".join(cells) + " |")
    return lines


def picture_table(rows: list[dict]) -> list[str]:
    """How pictures differ from ours."""
    lines = [
        "| | relative RMSE | pixels off by 0.01 | RMSE of the others |",
        "|---|---:|---:|---:|",
    ]
    for row in rows:
        if row["difference"]:
            found = row["difference"]
            numbers = f"{found['rmse']:.2g} | {100 * found['off']:.2f} % | {found['rest']:.2g}"
            lines.append(f"| {row['name']} | {numbers} |")
    return lines


def gradient_table(rows: list[dict], references: dict[str, float]) -> list[str]:
    """Derivatives of the summed image, and as parts of central differences."""
    lines = ["| d sum / d | " + " | ".join(PROBES) + " |", "|---|" + "---:|" * len(PROBES)]
    exact = " | ".join(f"{references[probe]:.0f}" for probe in PROBES)
    lines.append(f"| central differences, converged, double | {exact} |")
    for row in rows:
        if set(row["sums"]) >= set(PROBES):
            fractions = (
                f"{row['sums'][p]:.0f} ({100 * row['sums'][p] / references[p]:.1f} %)"
                for p in PROBES
            )
            lines.append(f"| {row['name']} | " + " | ".join(fractions) + " |")
        elif row["sums"]:
            x, spread, own = (row["sums"][key] for key in ("sphere x", "spread", "own reference"))
            text = (
                f"{x:.0f} +- {spread:.0f} ({100 * x / own:.1f} % of its own differences, {own:.0f})"
            )
            lines.append(f"| {row['name']} | {text} | cannot, see below | cannot |")
    return lines


def limits_list(limits: dict[str, str]) -> list[str]:
    """What Mitsuba says of parameters, or nothing without Mitsuba."""
    if "missing" in limits:
        return []
    lines = [
        "## What Mitsuba 3 cannot differentiate",
        "",
        "By its own flags (`python benchmarks/peers/mitsuba_limits.py`). `Discontinuous` means",
        "that edges move. `prb_projective` follows them where it sees them directly or in shadows.",
        "",
    ]
    return [*lines, *(f"- {what}: {said}" for what, said in limits.items()), ""]


def ratio_table(rows: list[dict]) -> list[str]:
    """How many times longer the others took."""
    medians = {
        row["name"]: {call: row[call]["median"] for call in TIMED if call in row} for row in rows
    }
    lines = [
        "## Times as multiples of ours",
        "",
        "| | image, of plain | gradient, of plain | gradient, of that with edges |",
    ]
    lines.append("|---|---:|---:|---:|")
    for name, own in medians.items():
        if name not in (PLAIN, OURS, KERNEL):
            pairs = (("image", PLAIN), ("gradient", PLAIN), ("gradient", OURS))
            numbers = (
                f"{own[call] / medians[ours][call]:.1f}" if call in own else "-"
                for call, ours in pairs
            )
            lines.append(f"| {name} | " + " | ".join(numbers) + " |")
    return [*lines, ""]


def kernel_table(rows: list[dict]) -> list[str]:
    """How many times longer our kernel for the plain image takes than other code, by both times."""
    times = {row["name"]: row["image"] for row in rows if "image" in row}
    lines = [
        "## How far our kernel is from other code",
        "",
        "The time of the kernel for the plain image, as a multiple of what others take.",
        "",
        "| | by medians | by the fastest calls |",
        "|---|---:|---:|",
    ]
    for name in CODE:
        if name in times:
            ratios = (times[KERNEL][by] / times[name][by] for by in ("median", "fastest"))
            lines.append(f"| {name} | " + " | ".join(f"{ratio:.2f}" for ratio in ratios) + " |")
    return [*lines, ""]


def document(
    rows: list[dict],
    missing: dict,
    references: dict[str, float],
    limits: dict[str, str],
    rounds: int,
) -> str:
    """The whole page."""
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Linux"
    lines = [
        "# Peers",
        "",
        "Written by `python benchmarks/peers/run.py`. Every number is of that one run.",
        "",
        f"The scene is that of `benchmarks/yardstick.toml`, 512 x 512, depth 5, on {machine}.",
        f"Times are medians of {rounds} rounds in which all peers took turns, each in a process",
        f"of its own; calls of more than {SLOW / 1e3:g} s were made {TURNS} times, short calls as",
        f"often as fit in {TURN} ms of each turn. The gradient is",
        "of the mean of squares by 12 parameters (24 numbers); that of Mitsuba's own integrators",
        "is by the position of a sphere. Compile time is how much longer the first call took than",
        "later ones; for C++ it is the compiler's. Memory is the peak.",
        "",
        *speed_table(rows),
        "",
        "![Times of peers](peers.png)",
        "",
        *ratio_table(rows),
        *kernel_table(rows),
        "## Is it the same picture?",
        "",
        "Compared with `boundary=False`, one sample at each pixel's centre. On the diagonals of",
        "the picture, walls meet at the centres of pixels: there rounding decides which is seen.",
        "",
        *picture_table(rows),
        "",
    ]
    names = {row["name"] for row in rows}
    lines += [f"- {name}: {note}" for name, note in NOTES.items() if name in names]
    lines += [
        "",
        "## Gradients",
        "",
        "Derivatives of the summed image. Parentheses tell which part they are of the central",
        "differences (double precision, `boundary=True`, 16 samples a pixel, step 1e-4).",
        "",
        *gradient_table(rows, references),
        "",
        *limits_list(limits),
    ]
    lines += [f"Not installed: {name} ({why})." for name, why in missing.items()]
    return "\n".join(lines).rstrip() + "\n"


def plot(rows: list[dict], path: Path) -> None:
    """Draw the times as bars."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(10, 0.6 * len(rows) + 1.2), constrained_layout=True)
    for call, shift, color in (("image", 0.2, "#4477aa"), ("gradient", -0.2, "#ee6677")):
        found = [
            (len(rows) - k + shift, row[call]["median"])
            for k, row in enumerate(rows)
            if call in row
        ]
        places, times = zip(*found, strict=True)
        bars = axes.barh(places, times, 0.38, label=call, color=color)
        axes.bar_label(bars, [f"{time:.1f}" for time in times], padding=3, fontsize=8)
    axes.set_yticks([len(rows) - k for k in range(len(rows))], [row["name"] for row in rows])
    axes.set(
        xscale="log", xlabel="milliseconds, median, 512 x 512", title="One scene, taking turns"
    )
    axes.margins(x=0.12)
    axes.legend()
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rounds", nargs="?", type=int, default=15, help="turns of each peer")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=HERE.parents[1] / "results",
        metavar="DIR",
        help="folder for peers.md and peers.png [default: results]",
    )
    parser.add_argument(
        "--without",
        nargs="+",
        default=[],
        choices=[name for name in PEERS if name not in (PLAIN, OURS, KERNEL)],
        help="peers to leave out, as they stand in the table",
    )
    arguments = parser.parse_args()
    rows, missing = measure(arguments.rounds, arguments.without)
    references, limits = script("reference.py"), script("mitsuba_limits.py")
    arguments.output.mkdir(parents=True, exist_ok=True)
    page = document(rows, missing, references, limits, arguments.rounds)
    (arguments.output / "peers.md").write_text(page)
    plot(rows, arguments.output / "peers.png")
    print(page)


if __name__ == "__main__":
    main()
