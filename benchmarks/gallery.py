"""Draw the README's pictures of derivatives.

python benchmarks/gallery.py [OUT.png]
"""

import sys
import tempfile
from pathlib import Path

from PIL import Image

from whitted.cli import run

ROOT = Path(__file__).parents[1]
# A parameter, and a component if it is a vector: a position, an index, a light and the camera
PARAMETERS = [
    ("spheres.diffuse.center", "x"),
    ("materials.glass.ior", None),
    ("lights.key.position", "x"),
    ("camera.fov", None),
]
# Samples and size of each picture
OPTIONS = ["--spp", "16", "--size", "288x288"]


def picture(folder: Path, name: str, component: str | None) -> Image.Image:
    """What `whitted gradient` draws for a parameter."""
    output = folder / f"{name}.png"
    arguments = ["gradient", str(ROOT / "scenes/cornell.toml"), "--wrt", name, *OPTIONS]
    if component:
        arguments += ["--component", component]
    status = run([*arguments, "-o", str(output)])
    if status:
        sys.exit(status)
    return Image.open(output).copy()


def main() -> None:
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "results/gallery.png"
    with tempfile.TemporaryDirectory() as folder:
        pictures = [picture(Path(folder), *parameter) for parameter in PARAMETERS]
    size = sum(p.width for p in pictures), max(p.height for p in pictures)
    whole = Image.new("RGB", size, "white")
    left = 0
    for p in pictures:
        whole.paste(p, (left, 0))
        left += p.width
    whole.save(out, optimize=True)


if __name__ == "__main__":
    main()
