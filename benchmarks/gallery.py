"""The README's pictures of derivatives: python benchmarks/gallery.py [OUT.png]"""

import sys
import tempfile
from pathlib import Path

from PIL import Image

from whitted.cli import run

ROOT = Path(__file__).parents[1]
# One parameter of each kind: a position, an index, a light, the camera
PARAMETERS = [
    ("spheres.diffuse.center", "x"),
    ("materials.glass.ior", None),
    ("lights.key.position", "x"),
    ("camera.fov", None),
]


def picture(folder: Path, name: str, component: str | None) -> Image.Image:
    """What `whitted gradient` draws for a parameter."""
    arguments = [
        "gradient",
        str(ROOT / "scenes/cornell.toml"),
        "--wrt",
        name,
        "--spp",
        "16",
        "--size",
        "288x288",
    ]
    output = folder / f"{name}.exr"
    status = run(
        [*arguments, *(["--component", component] if component else []), "-o", str(output)]
    )
    if status:
        sys.exit(status)
    return Image.open(output.with_suffix(".png")).copy()


def main() -> None:
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/gallery.png"
    with tempfile.TemporaryDirectory() as folder:
        pictures = [picture(Path(folder), *parameter) for parameter in PARAMETERS]
    whole = Image.new(
        "RGB", (sum(p.width for p in pictures), max(p.height for p in pictures)), "white"
    )
    left = 0
    for p in pictures:
        whole.paste(p, (left, 0))
        left += p.width
    whole.save(out, optimize=True)


if __name__ == "__main__":
    main()
