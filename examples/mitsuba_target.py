"""The position of a matte ball and the index of a glass ball, from Mitsuba 3's pictures.

Needs the extra `mitsuba`. What differs between the renderers, and what is done about it:

- Mitsuba's point light falls off with the squared distance: `falloff = "inverse-square"`.
- Its matte surfaces reflect albedo / pi: `gain=True` fits the brightness of each channel.
- Its paths go on between matte surfaces, which lights shadows a little: `ambient` is fitted too.

Glass throws a full shadow in both: neither sees a point light through an ideal surface.

What is left, light between matte surfaces, no numbers explain. The fit says so, and makes no
further tries here.
"""

import math

import numpy as np
from common import HERE, arguments, recover

import whitted as wt

FLOOR, BALL = [0.5, 0.5, 0.45], [0.7, 0.2, 0.15]


def description(size: int, glass: bool) -> dict:
    """The scene of foreign.toml, or of foreign_glass.toml, as Mitsuba describes it."""
    import mitsuba as mi

    look = mi.ScalarTransform4f().look_at(origin=[0, 1.5, 5], target=[0, 0, 0], up=[0, 1, 0])
    wide = mi.ScalarTransform4f().translate([0, -1, 0]).rotate([1, 0, 0], -90).scale(50)
    floor, matte = (
        {"type": "diffuse", "reflectance": {"type": "rgb", "value": color}}
        for color in (FLOOR, BALL)
    )
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 8},
        "sensor": {
            "type": "perspective",
            "fov": 40,
            "to_world": look,
            "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
            "sampler": {"type": "multijitter", "sample_count": 256},
        },
        "light": {
            "type": "point",
            "position": [2, 4, 3],
            "intensity": {"type": "rgb", "value": [20 * math.pi] * 3},
        },
        "floor": {"type": "rectangle", "to_world": wide, "bsdf": floor},
        "matte": {"type": "sphere", "center": [0.9, -0.4, -0.6], "radius": 0.6, "bsdf": matte},
    }
    if glass:
        scene["glass"] = {
            "type": "sphere",
            "center": [-0.4, -0.3, 0.5],
            "radius": 0.7,
            "bsdf": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0},
        }
    return scene


def picture(size: int, glass: bool) -> np.ndarray:
    """Mitsuba's picture of that scene."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    return np.array(mi.render(mi.load_dict(description(size, glass))))


if __name__ == "__main__":
    asked = arguments(__doc__)
    for glass in (False, True):
        truth = wt.load_scene(HERE / ("foreign_glass.toml" if glass else "foreign.toml"))
        start = {"spheres.matte.center": [0.7, -0.3, -0.8], "ambient": [0.01, 0.01, 0.01]}
        if glass:
            start |= {"materials.glass.ior": 1.4}
        title = "Foreign glass" if glass else "Foreign matte"
        found, _ = recover(
            title,
            truth,
            start,
            asked.size,
            asked.output,
            target=picture(asked.size, glass),
            gain=True,
            budget=None,
        )
        print(found.quality)
