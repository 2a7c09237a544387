"""Mitsuba 3 (LLVM) with its own integrators: mitsuba_paths.py path|prb|prb_projective

This is not the same work: paths are random, and go on between matte surfaces. There are 16 samples
a pixel, at depth 5. The image is that of `path`. The gradients of `prb` and `prb_projective` are of
the mean of squares by the position of the matte sphere. They cannot differentiate by the index of a
smooth dielectric, the position of a point light or the camera: see `mitsuba_limits.py`.
"""

import sys

import common
import numpy as np

SIZE, SPP = 512, 16
# The step, and the samples a pixel, of the differences that the derivatives are compared with
STEP, MANY = 0.02, 64


def description(integrator: str) -> dict:
    """The scene as Mitsuba describes it, with those of its materials that are nearest to ours."""
    import mitsuba as mi

    loaded = common.scene()
    camera, light = loaded["camera"], loaded["lights"][0]
    look = mi.ScalarTransform4f().look_at(
        origin=camera["position"], target=camera["look_at"], up=[0, 1, 0]
    )
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": "box"}}
    # With guiding, a gradient of this scene by prb_projective took more than two minutes
    guiding = {"guiding": "none"} if integrator == "prb_projective" else {}
    scene = {
        "type": "scene",
        "integrator": {"type": integrator, "max_depth": loaded["max_depth"] + 1, **guiding},
        "sensor": {"type": "perspective", "fov": camera["fov"], "to_world": look, "film": film},
        "light": {
            "type": "point",
            "position": light["position"],
            "intensity": {"type": "rgb", "value": light["intensity"]},
        },
    }
    special = {
        "mirror": {
            "type": "conductor",
            "material": "none",
            "specular_reflectance": {"type": "rgb", "value": [0.9] * 3},
        },
        "glass": {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0},
    }
    for k, sphere in enumerate(loaded["spheres"]):
        place = mi.ScalarTransform4f().translate(sphere["center"]).scale(sphere["radius"])
        scene[f"s{k}"] = {
            "type": "sphere",
            "to_world": place,
            "bsdf": special.get(sphere["material"]) or matte(loaded, sphere),
        }
    for k, plane in enumerate(loaded["planes"]):
        n = np.array(plane["normal"], float)
        wall = (
            mi.ScalarTransform4f()
            .look_at(origin=list(-n), target=[0, 0, 0], up=list(np.roll(n, 1)))
            .scale(3.3)
        )
        scene[f"p{k}"] = {"type": "rectangle", "to_world": wall, "bsdf": matte(loaded, plane)}
    return scene


def matte(loaded: dict, shape: dict) -> dict:
    color = {"type": "rgb", "value": loaded["materials"][shape["material"]]["color"]}
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": color}}


class Mitsuba(common.Peer):
    """The image, or the gradient by the matte sphere's position."""

    def __init__(self, integrator: str) -> None:
        import drjit as dr
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
        self.dr, self.mi, self.seed = dr, mi, 0
        self.scene = mi.load_dict(description(integrator))
        self.parameters = mi.traverse(self.scene)
        if integrator == "path":
            self.gradient, self.sums = None, None
        else:
            self.image = None

    def picture(self, place, spp: int):
        """The image with the matte sphere at a place. Its noise is that of `self.seed`."""
        mi = self.mi
        self.parameters["s2.to_world"] = mi.AffineTransform4f().translate(place).scale(0.2)
        self.parameters.update()
        return mi.render(self.scene, self.parameters, spp=spp, seed=self.seed)

    def place(self, change: float = 0):
        center = common.values()["spheres.sphere2.center"]
        return self.mi.Point3f(center[0] + change, *center[1:])

    def image(self):
        self.seed += 1
        image = self.picture(self.place(), SPP)
        self.dr.eval(image)
        self.dr.sync_thread()
        return image.numpy()

    def gradient(self, loss=None) -> list[float]:
        dr, place = self.dr, self.place()
        self.seed += 1
        dr.enable_grad(place)
        image = self.picture(place, SPP)
        dr.backward(loss(image) if loss else dr.mean(dr.square(image), axis=None))
        return [float(v) for v in np.ravel(dr.grad(place).numpy())]

    def sums(self) -> dict[str, float]:
        """The derivative of the summed image by the sphere's x.

        Given are the mean and the spread of two estimates, and a central difference of Mitsuba's
        own images.
        """
        found = [self.gradient(lambda image: self.dr.sum(image, axis=None))[0] for _ in range(2)]
        upper, lower = (
            float(self.picture(self.place(change), MANY).numpy().sum(dtype=float))
            for change in (STEP, -STEP)
        )
        exact = (upper - lower) / (2 * STEP)
        return {
            "sphere x": float(np.mean(found)),
            "spread": float(np.std(found, ddof=1)),
            "own reference": exact,
        }


if __name__ == "__main__":
    common.serve(lambda: Mitsuba(sys.argv[1]))
