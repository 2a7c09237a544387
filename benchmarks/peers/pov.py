"""POV-Ray 3.7: the scene written in its language, traced in two threads without antialiasing."""

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import common

SIZE = 512


def vector(v: list[float]) -> str:
    return "<" + ", ".join(f"{x:.9g}" for x in v) + ">"


def texture(material: dict, ambient: list[float]) -> str:
    """A material as a texture and an interior."""
    color = [*material.get("color", [0, 0, 0]), 0, material.get("refraction", 0)]
    # A highlight of roughness r is Blinn's with the exponent 1 / r
    shine = f"specular {material.get('specular', 0)} roughness {1 / material.get('shininess', 50)}"
    glow, mirror = f"ambient rgb {vector(ambient)}", f"reflection {material.get('reflection', 0)}"
    finish = f"{glow} diffuse 1 {shine} {mirror}"
    # The pigment of glass is black, and lets what is behind it through unfiltered, by its weight
    glass = f" interior {{ ior {material.get('ior', 1.5)} }}" if color[4] else ""
    return f"texture {{ pigment {{ color rgbft {vector(color)} }} finish {{ {finish} }} }}{glass}"


def export(scene: dict) -> str:
    """The scene in POV-Ray's language.

    The x axis is turned around, as POV-Ray's coordinates are left-handed.
    """
    camera, materials = scene["camera"], scene["materials"]
    black = [0, 0, 0]
    axes = "right <-1, 0, 0> up <0, 1, 0> direction <0, 0, 1>"
    place, target = vector(camera["position"]), vector(camera["look_at"])
    view = f"location {place} {axes} angle {camera['fov']} look_at {target}"
    depth = scene.get("max_depth", 5)
    lines = [
        "#version 3.7;",
        f"global_settings {{ assumed_gamma 1 max_trace_level {depth} adc_bailout 0 }}",
        f"camera {{ perspective {view} }}",
        f"background {{ color rgb {vector(scene.get('background', black))} }}",
    ]
    for light in scene["lights"]:
        shines = f"{vector(light['position'])} color rgb {vector(light['intensity'])}"
        lines.append(f"light_source {{ {shines} }}")
    for name, material in materials.items():
        body = texture(material, scene.get("ambient", black))
        lines.append(f"#declare {name}_ = material {{ {body} }}")
    for sphere in scene.get("spheres", []):
        ball = f"{vector(sphere['center'])}, {sphere['radius']}"
        lines.append(f"sphere {{ {ball} material {{ {sphere['material']}_ }} }}")
    for cloud in scene.get("clouds", []):
        material = f"material {{ {cloud['material']}_ }}"
        balls = (f"{vector(center)}, {radius:.9g}" for *center, radius in cloud["spheres"])
        lines += [f"sphere {{ {ball} {material} }}" for ball in balls]
    for plane in scene["planes"]:
        place = f"{vector(plane['normal'])}, {-plane['offset']}"
        lines.append(f"plane {{ {place} material {{ {plane['material']}_ }} }}")
    return "\n".join(lines) + "\n"


def read(path: Path):
    """The picture of a PPM file with linear numbers of 16 bits."""
    import numpy as np

    # Counted from the end, as the header's length varies: it has comments
    pixels = np.frombuffer(path.read_bytes()[-6 * SIZE * SIZE :], ">u2")
    return pixels.reshape(SIZE, SIZE, 3) / 65535


class Pov(common.Peer):
    """The image, and the times of parsing and of tracing that the program prints."""

    def __init__(self, scene: dict) -> None:
        self.program, self.scene = shutil.which("povray"), scene
        if self.program is None:
            raise common.MissingError("povray is not installed")
        self.folder = tempfile.TemporaryDirectory()

    def image(self):
        folder = Path(self.folder.name)
        (folder / "scene.pov").write_text(export(self.scene))
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
        times = re.findall(r"(\w+) Time:.*?\(([\d.]+) seconds\)", done.stderr)
        seconds = {what: float(time) for what, time in times}
        self.compiled, self.milliseconds = seconds["Parse"], seconds["Trace"] * 1e3
        return read(folder / "picture.ppm")


if __name__ == "__main__":
    common.serve(lambda: Pov(common.scene(*sys.argv[1:])))
