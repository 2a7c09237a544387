"""C++: tracer.cpp with -O3 -march=native in two threads, gradients in forward mode."""

import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import common


class Cpp(common.Peer):
    """The image and its gradient, by a program that prints them."""

    def __init__(self) -> None:
        compiler = shutil.which("g++")
        if compiler is None:
            raise common.MissingError("g++ is not installed")
        self.folder = tempfile.TemporaryDirectory()
        self.program = Path(self.folder.name) / "tracer"
        flags = ["-std=c++17", "-O3", "-march=native", "-pthread"]
        start = time.perf_counter()
        subprocess.run(
            [compiler, *flags, common.HERE / "tracer.cpp", "-o", self.program], check=True
        )
        self.compiled = time.perf_counter() - start

    def run(self, what: str) -> tuple[dict[str, list[str]], bytes]:
        """What the program printed, by the first word of each line, and its picture."""
        picture = Path(self.folder.name) / "picture"
        printed = subprocess.run(
            [self.program, what, picture], check=True, capture_output=True, text=True
        ).stdout
        lines = {line.split()[0]: line.split()[1:] for line in printed.splitlines()}
        self.milliseconds, self.megabytes = float(lines["ms"][0]), int(lines["memory"][0]) / 1024
        return lines, picture.read_bytes()

    def image(self):
        import numpy as np

        return np.frombuffer(self.run("image")[1], np.float32).reshape(512, 512, 3)

    def gradient(self) -> list[float]:
        return [float(v) for v in self.run("gradient")[0]["loss"]]

    def sums(self) -> dict[str, float]:
        found = self.run("gradient")[0]["sum"]
        return {name: float(found[place]) for name, place in common.PROBES.items()}


if __name__ == "__main__":
    common.serve(Cpp)
