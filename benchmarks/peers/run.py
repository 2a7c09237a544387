"""Other renderers beside this one, on the same scene in the same run: python
benchmarks/peers/run.py [ROUNDS] [-o DIR]

Each peer that is installed is a process of its own, with empty caches. Its first image and gradient
are timed alone, for the compile time; then all take turns. Writes peers.md and peers.png (needs the
`bench` extra) to docs, or to DIR.
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

HERE = Path(__file__).parent
OURS = "whitted, boundary=True"
PLAIN = "whitted, boundary=False"
PEERS = {
    PLAIN: ["ours.py", "plain"],
    OURS: ["ours.py", "boundary"],
    "C++, scalar": ["cpp.py"],
    "POV-Ray 3.7": ["pov.py"],
    "JAX": ["jax_peer.py"],
    "NumPy": ["numpy_peer.py"],
    "Mitsuba 3, Whitted": ["mitsuba_whitted.py"],
    "Mitsuba 3, path": ["mitsuba_paths.py", "path"],
    "Mitsuba 3, prb": ["mitsuba_paths.py", "prb"],
    "Mitsuba 3, prb_projective": ["mitsuba_paths.py", "prb_projective"],
}
NOTES = {
    PLAIN: "edges of pixels and shadows as samples fall, derivatives of samples alone",
    OURS: "derivatives right at edges",
    "C++, scalar": "forward mode by dual numbers of 24 derivatives, two threads",
    "POV-Ray 3.7": "trace time that it prints, without parsing; no derivatives",
    "JAX": "generations of rays packed into arrays of fixed size, `grad`",
    "NumPy": "generations of rays; no derivatives",
    "Mitsuba 3, Whitted": "the same work in Mitsuba's Python interface: generations of rays, its shapes, plain AD",
    "Mitsuba 3, path": "**other work**: 16 random paths a pixel, which light bounces between walls; its materials",
    "Mitsuba 3, prb": "**other work**: the gradient of `path` by the place of one sphere, no edges",
    "Mitsuba 3, prb_projective": "**other work**: likewise, with edges that it can see",
}
PROBES = ("sphere x", "mirror x", "index")
# Peers whose calls take longer than so many milliseconds have so many turns
SLOW, TURNS = 1000, 3


class Worker:
    """A peer's process."""

    def __init__(self, name: str, cache: str) -> None:
        environment = {**os.environ, "DRJIT_CACHE_DIR": str(Path(cache) / name.replace(" ", "_"))}
        command = [sys.executable, str(HERE / PEERS[name][0]), *PEERS[name][1:]]
        self.name, self.times, self.first = name, {"image": [], "gradient": []}, {}
        self.megabytes, self.picture, self.sums, self.compiled = (
            {},
            Path(cache) / f"{len(os.listdir(cache))}.npy",
            {},
            None,
        )
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(
            command, env=environment, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True
        )
        ready = self.read()
        self.missing = ready.get("missing")
        self.cannot = set()

    def read(self) -> dict:
        line = self.process.stdout.readline()
        return (
            json.loads(line) if line else {"missing": f"stopped with status {self.process.wait()}"}
        )

    def ask(self, call: str, **more) -> dict:
        """One call's answer."""
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
        """The first calls, which compile."""
        for call in self.times:
            reply = self.ask(call)
            if reply:
                self.first[call], self.megabytes[call], self.compiled = (
                    reply["ms"],
                    reply["megabytes"],
                    reply["compiled"],
                )
        self.ask("image", path=str(self.picture))
        self.sums = self.ask("sums").get("result", {})

    def turn(self) -> None:
        """One round."""
        for call, times in self.times.items():
            enough = len(times) >= TURNS and statistics.median(times) > SLOW
            reply = {} if enough else self.ask(call)
            if reply:
                times.append(reply["ms"])
                self.megabytes[call] = max(self.megabytes[call], reply["megabytes"])

    def seconds(self, call: str) -> float:
        """What the first call took more than later ones, or the compiler did."""
        if self.compiled is not None:
            return self.compiled
        return max(0.0, self.first[call] - statistics.median(self.times[call])) / 1e3

    def row(self) -> dict:
        """All that was measured."""
        row = {"name": self.name, "sums": self.sums}
        for call, times in self.times.items():
            if times:
                numbers = {
                    "median": statistics.median(times),
                    "fastest": min(times),
                    "megabytes": self.megabytes[call],
                }
                row[call] = numbers | {"compile": self.seconds(call)}
        return row


def unlike(picture: Path, ours: Path) -> dict:
    """How a picture differs from ours: relative RMSE of all pixels, share of pixels off by 0.01,
    and RMSE of the others.
    """
    import numpy as np

    if not picture.exists():
        return {}
    a, b = np.load(picture), np.load(ours)
    off = abs(a - b).max(axis=2) > 0.01
    return {
        "rmse": float(np.linalg.norm(a - b) / np.linalg.norm(b)),
        "off": float(off.mean()),
        "rest": float(np.linalg.norm((a - b)[~off]) / np.linalg.norm(b[~off]))
        if not off.all()
        else float("nan"),
    }


def measure(rounds: int) -> tuple[list[dict], dict[str, str]]:
    """Rows of the peers that are installed, and why the others are not here."""
    with tempfile.TemporaryDirectory() as cache:
        workers = []
        for name in PEERS:
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
                rows.append(worker.row() | {"unlike": unlike(worker.picture, workers[0].picture)})
        return rows, {worker.name: worker.missing for worker in workers if worker.missing}


def script(name: str) -> str:
    """What another script of this folder prints."""
    return subprocess.run(
        [sys.executable, str(HERE / name)], check=True, capture_output=True, text=True
    ).stdout


def cells(row: dict, call: str, field: str, form: str) -> str:
    return form.format(row[call][field]) if call in row else "-"


def speed_table(rows: list[dict]) -> list[str]:
    """Times, compile times and memory."""
    lines = [
        "| | image, ms | fastest | gradient, ms | fastest | compile, s: image | gradient | memory, MB: image | gradient |"
    ]
    lines.append("|---|" + "---:|" * 8)
    for row in rows:
        times = [
            cells(row, call, field, "{:.1f}")
            for call in ("image", "gradient")
            for field in ("median", "fastest")
        ]
        other = [
            cells(row, c, f, "{:.1f}" if f == "compile" else "{:.0f}")
            for f in ("compile", "megabytes")
            for c in TIMED
        ]
        lines.append(f"| {row['name']} | " + " | ".join(times + other) + " |")
    return lines


TIMED = ("image", "gradient")


def picture_table(rows: list[dict]) -> list[str]:
    """How pictures differ from ours."""
    lines = [
        "| | relative RMSE | pixels off by 0.01 | RMSE of the others |",
        "|---|---:|---:|---:|",
    ]
    for row in rows:
        if row["unlike"]:
            u = row["unlike"]
            numbers = f"{u['rmse']:.2g} | {100 * u['off']:.2f} % | {u['rest']:.2g}"
            lines.append(f"| {row['name']} | {numbers} |")
    return lines


def gradient_table(rows: list[dict], references: dict[str, float]) -> list[str]:
    """Derivatives of the summed image, as fractions of central differences."""
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
    """What Mitsuba says of parameters."""
    if "missing" in limits:
        return []
    lines = [
        "## What Mitsuba 3 cannot differentiate",
        "",
        "By its own flags (`python benchmarks/peers/mitsuba_limits.py`);",
    ]
    lines += [
        "`Discontinuous` means that edges move, which `prb_projective` follows where it sees them directly or in shadows.",
        "",
    ]
    return [*lines, *(f"- {what}: {said}" for what, said in limits.items()), ""]


def targets(rows: list[dict]) -> list[str]:
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
        if name not in (PLAIN, OURS):
            pairs = (("image", PLAIN), ("gradient", PLAIN), ("gradient", OURS))
            numbers = (
                f"{own[call] / medians[ours][call]:.1f}" if call in own else "-"
                for call, ours in pairs
            )
            lines.append(f"| {name} | " + " | ".join(numbers) + " |")
    return [*lines, ""]


def document(
    rows: list[dict],
    missing: dict,
    references: dict[str, float],
    limits: dict[str, str],
    rounds: int,
) -> str:
    """The page."""
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Linux"
    lines = [
        "# Peers",
        "",
        "Written by `python benchmarks/peers/run.py`; every number is of that one run.",
        "",
    ]
    lines += [
        f"The scene of `benchmarks/yardstick.toml`, 512 x 512, depth 5, on {machine}. Medians of {rounds} rounds in which all",
        f"peers took turns ({TURNS} rounds for calls of more than {SLOW / 1e3:g} s), each in a process of its own. The gradient",
        "is of the mean of squares by 12 parameters (24 numbers); Mitsuba's own integrators' is by a sphere's place.",
        "Compile time is what the first call took more than later ones; C++'s is its compiler's. Memory is the peak.",
        "",
    ]
    lines += [*speed_table(rows), "", "![Times of peers](peers.png)", "", *targets(rows)]
    lines += [
        "Hand-written AVX-512 code takes 0.5-0.7 ms for this image on a machine on which scalar C++ takes 7-9 ms (measured by",
        "others, elsewhere): some 5 times less than Dr.Jit's kernels, if the ratio to scalar C++ carries over.",
        "",
    ]
    lines += [
        "## Is it the same picture?",
        "",
        "Against `boundary=False`, one sample at each pixel's centre.",
        "",
    ]
    lines += [*picture_table(rows), ""]
    lines += [
        f"- {name}: {note}"
        for name, note in NOTES.items()
        if any(row["name"] == name for row in rows)
    ]
    lines += ["", "## Gradients", ""]
    lines += [
        "Derivatives of the summed image, in parentheses as a part of the central differences (double, `boundary=True`,"
    ]
    lines += [
        "16 samples a pixel, step 1e-4).",
        "",
        *gradient_table(rows, references),
        "",
        *limits_list(limits),
    ]
    lines += [f"Not installed: {name} ({why})." for name, why in missing.items()]
    return "\n".join(lines).rstrip() + "\n"


def plot(rows: list[dict], path: Path) -> None:
    """Bars of the times."""
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
    parser.add_argument("rounds", nargs="?", type=int, default=15)
    parser.add_argument("-o", "--output", type=Path, default=HERE.parents[1] / "docs")
    arguments = parser.parse_args()
    rows, missing = measure(arguments.rounds)
    references, limits = json.loads(script("reference.py")), json.loads(script("mitsuba_limits.py"))
    arguments.output.mkdir(parents=True, exist_ok=True)
    page = document(rows, missing, references, limits, arguments.rounds)
    (arguments.output / "peers.md").write_text(page)
    plot(rows, arguments.output / "peers.png")
    print(page)


if __name__ == "__main__":
    main()
