"""POV-Ray 3.7: the scene written in its language, traced in two threads without antialiasing."""

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import common

SIZE = 512


def vector(v: list[float]) -> str:
    return "<" + ", ".join(f"{x:g}" for x in v) + ">"


def texture(material: dict) -> str:
    """A material as a texture and an interior."""
    color = [*material.get("color", [0, 0, 0]), 0, material.get("refraction", 0)]
    # A highlight of roughness r is Blinn's with the exponent 1 / r
    shine = f"specular {material.get('specular', 0)} roughness {1 / material.get('shininess', 50)}"
    finish = f"ambient 0 diffuse 1 {shine} reflection {material.get('reflection', 0)}"
    # The pigment of glass is black, and lets what is behind it through unfiltered, by its weight
    glass = f" interior {{ ior {material.get('ior', 1.5)} }}" if color[4] else ""
    return f"texture {{ pigment {{ color rgbft {vector(color)} }} finish {{ {finish} }} }}{glass}"


def export(scene: dict) -> str:
    """The scene in POV-Ray's language.

    The x axis is turned around, as POV-Ray's coordinates are left-handed.
    """
    camera, light = scene["camera"], scene["lights"][0]
    axes = "right <-1, 0, 0> up <0, 1, 0> direction <0, 0, 1>"
    place, target = vector(camera["position"]), vector(camera["look_at"])
    view = f"location {place} {axes} angle {camera['fov']} look_at {target}"
    shines = f"{vector(light['position'])} color rgb {vector(light['intensity'])}"
    lines = [
        "#version 3.7;",
        f"global_settings {{ assumed_gamma 1 max_trace_level {scene['max_depth']} adc_bailout 0 }}",
        f"camera {{ perspective {view} }}",
        f"light_source {{ {shines} }}",
    ]
    for sphere in scene["spheres"]:
        material = texture(scene["materials"][sphere["material"]])
        lines.append(f"sphere {{ {vector(sphere['center'])}, {sphere['radius']} {material} }}")
    for plane in scene["planes"]:
        material = texture(scene["materials"][plane["material"]])
        lines.append(f"plane {{ {vector(plane['normal'])}, {-plane['offset']} {material} }}")
    return "\n".join(lines) + "\n"


def read(path: Path):
    """The picture of a PPM file with linear numbers of 16 bits."""
    import numpy as np

    # Counted from the end, as the header's length varies: it has comments
    pixels = np.frombuffer(path.read_bytes()[-6 * SIZE * SIZE :], ">u2")
    return pixels.reshape(SIZE, SIZE, 3) / 65535


class Pov(common.Peer):
    """The image, and the trace time that the program prints."""

    def __init__(self) -> None:
        self.program = shutil.which("povray")
        if self.program is None:
            raise common.MissingError("povray is not installed")
        self.folder = tempfile.TemporaryDirectory()
        self.compiled = 0.0

    def image(self):
        folder = Path(self.folder.name)
        (folder / "scene.pov").write_text(export(common.scene()))
        options = [
            f"+W{SIZE}",
            f"+H{SIZE}",
            "-A",
            "+WT2",
            "-D",
            "+FP16",
            "File_Gamma=1.0",
            "+Iscene.pov",
            "+Opicture.ppm",
            "-GD",
        ]
        done = subprocess.run(
            [self.program, *options], cwd=folder, check=True, capture_output=True, text=True
        )
        found = re.search(r"Trace Time:.*?\(([\d.]+) seconds\)", done.stderr)
        self.milliseconds = float(found[1]) * 1e3
        return read(folder / "picture.ppm")


if __name__ == "__main__":
    common.serve(Pov)
