"""The position of a matte ball, by our gradients and by those of Mitsuba 3.

Needs the extra `mitsuba`. Mitsuba's gradients are those of `prb` and of `prb_projective`. All start
at the same place, and take the same number of steps of Adam at the same rate. Mitsuba's target is
its own picture. `prb_projective` takes minutes; with its guiding of samples towards edges it would
take hours.
"""

import drjit as dr
import numpy as np
from common import HERE, arguments
from mitsuba_target import description

import whitted as wt

START, TRUE = np.array([0.7, -0.3, -0.8]), np.array([0.9, -0.4, -0.6])
STEPS, RATE = 60, 0.01


def theirs(size: int, integrator: str) -> np.ndarray:
    """The position that Mitsuba's gradients lead to."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    target = mi.render(mi.load_dict(description(size, glass=False)), spp=256)
    moved = description(size, glass=False)
    moved["matte"] |= {"center": [0, 0, 0], "radius": 1}
    moved["matte"]["to_world"] = mi.ScalarTransform4f().translate(START.tolist()).scale(0.6)
    moved["integrator"] = {"type": integrator, "max_depth": 8} | (
        {"guiding": "none"} if integrator == "prb_projective" else {}
    )
    scene = mi.load_dict(moved)
    parameters = mi.traverse(scene)
    optimiser = mi.ad.Adam(lr=RATE)
    optimiser["place"] = mi.Point3f(*START.tolist())
    for step in range(STEPS):
        parameters["matte.to_world"] = mi.Transform4f().translate(optimiser["place"]).scale(0.6)
        parameters.update()
        image = mi.render(scene, parameters, spp=16, seed=step)
        dr.backward(dr.mean(dr.square(image - target), axis=None))
        optimiser.step()
    return optimiser["place"].numpy().ravel()


def ours(size: int) -> np.ndarray:
    """The position that our gradients lead to, at one sample a pixel."""
    scene, resolution = wt.load_scene(HERE / "foreign.toml"), (size, size)
    target = wt.render(scene, 16, resolution=resolution)
    optimiser = dr.opt.Adam(RATE, params=scene.parameters("spheres.matte.center"))
    optimiser["spheres.matte.center"] = type(optimiser["spheres.matte.center"])(*START.tolist())
    for _ in range(STEPS):
        image = wt.render(scene.replace(optimiser), resolution=resolution)
        dr.backward(dr.mean(dr.square(image - target), axis=None))
        optimiser.step()
    return optimiser["spheres.matte.center"].numpy().ravel()


if __name__ == "__main__":
    asked = arguments(__doc__)
    away = f"distance to the truth; at the start {np.linalg.norm(START - TRUE):.4f}"
    print(f"{'':16}{'x':>9}{'y':>9}{'z':>9}   {away}")
    for name in ("ours", "prb", "prb_projective"):
        place = ours(asked.size) if name == "ours" else theirs(asked.size, name)
        numbers = "".join(f"{number:9.4f}" for number in place)
        print(f"{name:16}{numbers}   {np.linalg.norm(place - TRUE):.4f}", flush=True)
