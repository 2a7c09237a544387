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
    # Its highlight of roughness r is Blinn's with the exponent 1 / r
    shine = f"specular {material.get('specular', 0)} roughness {1 / material.get('shininess', 50)}"
    finish = f"ambient 0 diffuse 1 {shine} reflection {material.get('reflection', 0)}"
    # Clear glass filters nothing, so that its pigment is black with the weight left for what shines
    # through
    glass = f" interior {{ ior {material.get('ior', 1.5)} }}" if color[4] else ""
    return f"texture {{ pigment {{ color rgbft {vector(color)} }} finish {{ {finish} }} }}{glass}"


def export(scene: dict) -> str:
    """The scene in POV-Ray's language, whose x axis is turned as it is left-handed."""
    camera, light = scene["camera"], scene["lights"][0]
    view = f"location {vector(camera['position'])} right <-1, 0, 0> up <0, 1, 0> direction <0, 0, 1> angle {camera['fov']}"
    lines = [
        "#version 3.7;",
        f"global_settings {{ assumed_gamma 1 max_trace_level {scene['max_depth']} adc_bailout 0 }}",
    ]
    lines += [f"camera {{ perspective {view} look_at {vector(camera['look_at'])} }}"]
    lines += [
        f"light_source {{ {vector(light['position'])} color rgb {vector(light['intensity'])} }}"
    ]
    for sphere in scene["spheres"]:
        material = texture(scene["materials"][sphere["material"]])
        lines.append(f"sphere {{ {vector(sphere['center'])}, {sphere['radius']} {material} }}")
    for plane in scene["planes"]:
        material = texture(scene["materials"][plane["material"]])
        lines.append(f"plane {{ {vector(plane['normal'])}, {-plane['offset']} {material} }}")
    return "\n".join(lines) + "\n"


def read(path: Path):
    """The picture of a 16-bit PPM file, linear."""
    import numpy as np

    # Its header has comments
    return (
        np.frombuffer(path.read_bytes()[-6 * SIZE * SIZE :], ">u2").reshape(SIZE, SIZE, 3) / 65535
    )


class Pov(common.Peer):
    """Runs the program and reads the trace time that it prints."""

    def __init__(self) -> None:
        self.program = shutil.which("povray")
        if self.program is None:
            raise common.Missing("povray is not installed")
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
