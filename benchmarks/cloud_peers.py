"""Other programs beside clouds.py, each in a process of its own."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from clock import milliseconds

import whitted as wt

HERE = Path(__file__).parent
# The script of each, and the most spheres that it is given. Embree takes 11 s and 1.6 GB to load
# 100,000 shapes of Mitsuba.
PEERS = {"Embree": ("cloud_embree.py", 100_000), "POV-Ray": ("pov.py", 1_000_000)}


class Other:
    """Another program: a script of peers/ and its scene."""

    def __init__(self, script: str, path: Path) -> None:
        command = [sys.executable, str(HERE / "peers" / script), str(path)]
        pipe, quiet = subprocess.PIPE, subprocess.DEVNULL
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=quiet, text=True)
        self.answer = self.read()

    def read(self) -> dict:
        return json.loads(self.process.stdout.readline() or '{"missing": "it stopped"}')

    def call(self, **more: str) -> float:
        """Milliseconds of a picture."""
        print(json.dumps({"call": "image", **more}), file=self.process.stdin, flush=True)
        self.answer = self.read()
        return self.answer["ms"]

    def off(self, ours: np.ndarray, path: Path) -> float:
        """The part of the pixels that differ from ours by more than 0.01."""
        self.call(path=str(path))
        apart = np.abs(np.load(path).reshape(ours.shape) - ours).max(axis=2)
        return float((apart > 0.01).mean())

    def end(self) -> None:
        self.process.stdin.close()
        self.process.wait()


def in_turns(scene: wt.Scene, count: int, turns: int = 6) -> list[str]:
    """Cells: the time of the plain picture; the times of each peer and to load, and what differs.

    All take turns; times are the least, so that compiling in the first turn does not count.
    """

    def plain():
        return wt.render(scene, boundary=False)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.json"
        path.write_text(json.dumps(scene.to_dict()))
        others = {
            name: Other(script, path) for name, (script, most) in PEERS.items() if count <= most
        }
        for name in [name for name, other in others.items() if "missing" in other.answer]:
            print(f"{name} is left out: {others.pop(name).answer['missing']}", file=sys.stderr)
        calls = {"plain": lambda: milliseconds(plain)}
        calls |= {name: other.call for name, other in others.items()}
        times: dict[str, list[float]] = {name: [] for name in calls}
        for _ in range(turns):
            for name, call in calls.items():
                times[name].append(call())
        cells = [f"{min(times['plain']) / 1e3:.3f} s"]
        for name in PEERS:
            if name in others:
                other = others[name]
                off = other.off(np.array(plain()), Path(folder) / "picture.npy")
                cells += [f"{min(times[name]) / 1e3:.3f} s", f"{other.answer['compiled']:.3f} s"]
                cells.append(f"{100 * off:.2f} %")
                other.end()
            else:
                cells += ["-"] * 3
    return cells
