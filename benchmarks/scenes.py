"""Scenes of any size: the yardstick's box with more spheres, more lights, or other materials."""

from pathlib import Path

HEAD = (Path(__file__).parent / "yardstick.toml").read_text().split("[[spheres]]")[0]
WALLS = (
    ([0, 1, 0], "white"),
    ([0, -1, 0], "white"),
    ([1, 0, 0], "red"),
    ([-1, 0, 0], "blue"),
    ([0, 0, -1], "white"),
)
# Centres and radii of the yardstick's spheres
SPHERES = (([-0.45, -0.6, 0.2], 0.4), ([0.45, -0.65, -0.2], 0.35), ([0.1, -0.8, -0.7], 0.2))
MATERIALS = ("mirror", "glass", "green")


def box(materials: tuple[str, ...] = MATERIALS, spheres: int = 3, lights: int = 1) -> str:
    """A box with some spheres and lights, as the text of a scene file.

    The first three spheres are the yardstick's. Any others are small, and hang in a grid near the
    back wall. All lights together are as bright as one.
    """
    text = [HEAD]
    for k in range(spheres):
        (x, y, z), radius = (
            SPHERES[k] if k < 3 else ((-0.75 + 0.25 * (k % 7), 0.8 - 0.25 * (k // 7), 0.7), 0.08)
        )
        text.append(f"[[spheres]]\ncenter = [{x}, {y}, {z}]\nradius = {radius}")
        text.append(f'material = "{materials[k % 3]}"\n')
    for normal, material in WALLS:
        text.append(f'[[planes]]\nnormal = {normal}\noffset = 1\nmaterial = "{material}"\n')
    for k in range(lights):
        x = 0.05 * (k % 8) - 0.05 * min(lights - 1, 7) / 2
        z = -0.3 + 0.05 * (k // 8)
        text.append(f"[[lights]]\nposition = [{x}, 0.9, {z}]")
        text.append(f"intensity = [{1 / lights}, {1 / lights}, {1 / lights}]\n")
    return "\n".join(text)
