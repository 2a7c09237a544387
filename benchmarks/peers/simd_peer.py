"""C++ by hand: simd.cpp, whose packets fill AVX2 or AVX-512 registers: simd_peer.py avx2|avx512"""

import ctypes
import math
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import common
import numpy as np

FLAGS = {
    "avx2": ["-march=haswell"],
    "avx512": ["-march=skylake-avx512", "-mprefer-vector-width=512"],
}


def material(name: str, loaded: dict) -> list[float]:
    """The numbers of a material."""
    found = loaded["materials"][name]
    fields = {"specular": 0, "shininess": 50, "reflection": 0, "refraction": 0, "ior": 1.5}
    others = [found.get(field, default) for field, default in fields.items()]
    return [*found.get("color", [0, 0, 0]), *others]


def numbers(loaded: dict) -> np.ndarray:
    """All numbers of the scene, in the order of `Scene` in simd.cpp."""
    camera, light = loaded["camera"], loaded["lights"][0]
    position = np.array(camera["position"], float)
    forward = np.subtract(camera["look_at"], position)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    scale = math.tan(math.radians(camera["fov"] / 2))
    rows = [position, forward, right * scale, np.cross(right, forward) * scale]
    rows += [light["position"], light["intensity"]]
    for sphere in loaded["spheres"]:
        rows += [sphere["center"], [sphere["radius"]], material(sphere["material"], loaded)]
    for plane in loaded["planes"]:
        rows += [plane["normal"], [plane["offset"]], material(plane["material"], loaded)]
    return np.concatenate(rows).astype(np.float32)


class Simd(common.Peer):
    """The image."""

    def __init__(self, what: str) -> None:
        compiler = shutil.which("g++")
        if compiler is None:
            raise common.MissingError("g++ is not installed")
        if f" {what}" not in Path("/proc/cpuinfo").read_text():
            raise common.MissingError(f"this processor has no {what}")
        flags = ["-std=c++20", "-O3", "-fno-math-errno", "-fno-trapping-math", *FLAGS[what]]
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / "simd.so"
            start = time.perf_counter()
            subprocess.run(
                [compiler, *flags, "-shared", "-fPIC", common.HERE / "simd.cpp", "-o", library],
                check=True,
            )
            self.compiled = time.perf_counter() - start
            self.library = ctypes.CDLL(str(library))
        self.scene = numbers(common.scene())
        self.picture = np.zeros((512, 512, 3), np.float32)

    def image(self):
        self.library.render(
            self.scene.ctypes.data_as(ctypes.c_void_p), self.picture.ctypes.data_as(ctypes.c_void_p)
        )
        return self.picture


if __name__ == "__main__":
    common.serve(lambda: Simd(sys.argv[1]))
