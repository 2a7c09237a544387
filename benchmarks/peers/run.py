"""Other renderers beside this one, on the same scene in the same run: python benchmarks/peers/run.py [ROUNDS] [-o DIR]

Each peer that is installed is a process of its own, with empty caches. Its first image and gradient are timed alone, for
the compile time; then all take turns. Writes peers.md and peers.png (needs the `bench` extra) to docs, or to DIR.
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
}
NOTES = {
    "C++, scalar": "forward mode by dual numbers of 24 derivatives, two threads",
    "POV-Ray 3.7": "trace time that it prints, without parsing; no derivatives",
}
PROBES = ("sphere x", "mirror x", "index")


class Worker:
    """A peer's process."""

    def __init__(self, name: str, cache: str) -> None:
        environment = {**os.environ, "DRJIT_CACHE_DIR": str(Path(cache) / name.replace(" ", "_"))}
        command = [sys.executable, str(HERE / PEERS[name][0]), *PEERS[name][1:]]
        self.name, self.times, self.first = name, {"image": [], "gradient": []}, {}
        self.megabytes, self.picture, self.sums, self.compiled = {}, Path(cache) / f"{len(os.listdir(cache))}.npy", {}, None
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True)
        ready = self.read()
        self.missing = ready.get("missing")
        self.cannot = set()

    def read(self) -> dict:
        line = self.process.stdout.readline()
        return json.loads(line) if line else {"missing": f"stopped with status {self.process.wait()}"}

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
                self.first[call], self.megabytes[call], self.compiled = reply["ms"], reply["megabytes"], reply["compiled"]
        self.ask("image", path=str(self.picture))
        self.sums = self.ask("sums").get("result", {})

    def turn(self) -> None:
        """One round."""
        for call, times in self.times.items():
            reply = self.ask(call)
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
                numbers = {"median": statistics.median(times), "fastest": min(times), "megabytes": self.megabytes[call]}
                row[call] = numbers | {"compile": self.seconds(call)}
        return row


def unlike(picture: Path, ours: Path) -> dict:
    """How a picture differs from ours: relative RMSE of all pixels, share of pixels off by 0.01, and RMSE of the others."""
    import numpy as np

    if not picture.exists():
        return {}
    a, b = np.load(picture), np.load(ours)
    off = abs(a - b).max(axis=2) > 0.01
    return {
        "rmse": float(np.linalg.norm(a - b) / np.linalg.norm(b)),
        "off": float(off.mean()),
        "rest": float(np.linalg.norm((a - b)[~off]) / np.linalg.norm(b[~off])) if not off.all() else float("nan"),
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
    return subprocess.run([sys.executable, str(HERE / name)], check=True, capture_output=True, text=True).stdout


def cells(row: dict, call: str, field: str, form: str) -> str:
    return form.format(row[call][field]) if call in row else "-"


def speed_table(rows: list[dict]) -> list[str]:
    """Times, compile times and memory."""
    lines = ["| | image, ms | fastest | gradient, ms | fastest | compile, s: image | gradient | memory, MB: image | gradient |"]
    lines.append("|---|" + "---:|" * 8)
    for row in rows:
        times = [cells(row, call, field, "{:.1f}") for call in ("image", "gradient") for field in ("median", "fastest")]
        other = [cells(row, c, f, "{:.1f}" if f == "compile" else "{:.0f}") for f in ("compile", "megabytes") for c in TIMED]
        lines.append(f"| {row['name']} | " + " | ".join(times + other) + " |")
    return lines


TIMED = ("image", "gradient")


def picture_table(rows: list[dict]) -> list[str]:
    """How pictures differ from ours."""
    lines = ["| | relative RMSE | pixels off by 0.01 | RMSE of the others | note |", "|---|---:|---:|---:|---|"]
    for row in rows:
        if row["unlike"]:
            u = row["unlike"]
            numbers = f"{u['rmse']:.2g} | {100 * u['off']:.2f} % | {u['rest']:.2g}"
            lines.append(f"| {row['name']} | {numbers} | {NOTES.get(row['name'], '')} |")
    return lines


def gradient_table(rows: list[dict], references: dict[str, float]) -> list[str]:
    """Derivatives of the summed image, as fractions of central differences."""
    lines = ["| d sum / d | " + " | ".join(PROBES) + " |", "|---|" + "---:|" * len(PROBES)]
    exact = " | ".join(f"{references[probe]:.0f}" for probe in PROBES)
    lines.append(f"| central differences, converged, double | {exact} |")
    for row in rows:
        if row["sums"] and "path" not in row["name"]:
            fractions = (f"{row['sums'][p]:.0f} ({100 * row['sums'][p] / references[p]:.1f} %)" for p in PROBES)
            lines.append(f"| {row['name']} | " + " | ".join(fractions) + " |")
    return lines


def document(rows: list[dict], missing: dict, references: dict[str, float], rounds: int) -> str:
    """The page."""
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Linux, shared with other work while this ran"
    lines = ["# Peers", "", "Written by `python benchmarks/peers/run.py`; every number is of that one run.", ""]
    lines += [
        f"The scene of `benchmarks/yardstick.toml`, 512 x 512, depth 5, on {machine}. Medians of {rounds} rounds in which all"
    ]
    lines += [
        "peers took turns, each in a process of its own. The gradient is of the mean of squares by 12 parameters (24 numbers)."
    ]
    lines += ["Compile time is what the first call took more than later ones; C++'s is its compiler's. Memory is the peak.", ""]
    lines += [*speed_table(rows), "", "![Times of peers](peers.png)", ""]
    lines += ["## Is it the same picture?", "", "Against `boundary=False`, one sample at each pixel's centre.", ""]
    lines += [*picture_table(rows), "", "## Gradients", ""]
    lines += ["Derivatives of the summed image, in parentheses as a part of the central differences (double, `boundary=True`,"]
    lines += ["16 samples a pixel, step 1e-4).", "", *gradient_table(rows, references), ""]
    lines += [f"Not installed: {name} ({why})." for name, why in missing.items()]
    return "\n".join(lines).rstrip() + "\n"


def plot(rows: list[dict], path: Path) -> None:
    """Bars of the times."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(10, 0.6 * len(rows) + 1.2), constrained_layout=True)
    for call, shift, color in (("image", 0.2, "#4477aa"), ("gradient", -0.2, "#ee6677")):
        found = [(len(rows) - k + shift, row[call]["median"]) for k, row in enumerate(rows) if call in row]
        places, times = zip(*found, strict=True)
        bars = axes.barh(places, times, 0.38, label=call, color=color)
        axes.bar_label(bars, [f"{time:.1f}" for time in times], padding=3, fontsize=8)
    axes.set_yticks([len(rows) - k for k in range(len(rows))], [row["name"] for row in rows])
    axes.set(xscale="log", xlabel="milliseconds, median, 512 x 512", title="One scene, taking turns")
    axes.margins(x=0.12)
    axes.legend()
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rounds", nargs="?", type=int, default=15)
    parser.add_argument("-o", "--output", type=Path, default=HERE.parents[1] / "docs")
    arguments = parser.parse_args()
    rows, missing = measure(arguments.rounds)
    references = json.loads(script("reference.py"))
    arguments.output.mkdir(parents=True, exist_ok=True)
    page = document(rows, missing, references, arguments.rounds)
    (arguments.output / "peers.md").write_text(page)
    plot(rows, arguments.output / "peers.png")
    print(page)


if __name__ == "__main__":
    main()
