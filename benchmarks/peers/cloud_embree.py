"""Mitsuba 3 with Embree on a cloud of mirror balls, by its Python interface.

Each ball is a `sphere` of its own, and Embree finds what rays meet. Normals are computed here from
the balls' numbers: with `ray_intersect`, which asks each shape for them, Dr.Jit records a function
for every ball in each call, and a picture of 7381 balls took seconds.

Mitsuba's `ellipsoids`, one shape of many, loads in 0.01 s, but its hits in single precision are
wrong where balls are small: of a sphere-flake of 7381 balls half were off by more than 1e-4.
"""

import math
import sys
import time

import common
import numpy as np

# Half the side of the rectangle that stands for the ground
FAR = 1000


class Embree(common.Peer):
    """The picture of a scene of examples/flake.py."""

    def __init__(self, loaded: dict) -> None:
        import drjit as dr
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
        self.dr, self.mi, self.loaded = dr, mi, loaded
        balls = np.array(loaded["clouds"][0]["spheres"], np.float32)
        start = time.perf_counter()
        self.scene = mi.load_dict(self.shapes(balls))
        self.compiled = time.perf_counter() - start
        # The ground's radius is 0
        self.rows = mi.Float(self.spread(balls).ravel())

    def shapes(self, balls: np.ndarray) -> dict:
        """Mitsuba's scene, without materials or lights."""
        mi = self.mi
        down = mi.ScalarTransform4f().translate([0, -self.loaded["planes"][0]["offset"], 0])
        ground = down.rotate([1, 0, 0], -90).scale(FAR)
        scene = {"type": "scene", "ground": {"type": "rectangle", "to_world": ground}}
        for k, (*center, radius) in enumerate(balls.tolist()):
            scene[f"{k}"] = {"type": "sphere", "center": center, "radius": radius}
        return scene

    def spread(self, balls: np.ndarray) -> np.ndarray:
        """The balls' numbers by their places in Mitsuba's registry, 0 elsewhere."""
        places = self.dr.reinterpret_array(self.mi.UInt32, self.scene.shapes_dr()).numpy()
        spread = np.zeros((places.max() + 1, 4), np.float32)
        for place, shape in zip(places, self.scene.shapes(), strict=True):
            if shape.id() != "ground":
                spread[place] = balls[int(shape.id())]
        return spread

    def rays(self):
        """Rays through the pixels' centres, and their pixels.

        Blocks of 4 x 4 pixels are neighbours in memory.
        """
        dr, mi, camera = self.dr, self.mi, self.loaded["camera"]
        width, height = camera["resolution"]
        i = dr.arange(mi.UInt32, width * height)
        block, lane = i // 16, i % 16
        x, y = block % (width // 4) * 4 + lane % 4, block // (width // 4) * 4 + lane // 4
        origin = mi.Point3f(camera["position"])
        forward = dr.normalize(mi.Point3f(camera["look_at"]) - origin)
        right = dr.normalize(dr.cross(forward, mi.Vector3f(0, 1, 0)))
        scale = math.tan(math.radians(camera["fov"] / 2))
        u = (2 * (mi.Float(x) + 0.5) / width - 1) * scale
        v = (1 - 2 * (mi.Float(y) + 0.5) / height) * scale
        d = dr.normalize(forward + u * right + v * dr.cross(right, forward))
        return mi.Ray3f(origin, d), y * width + x

    def surface(self, ray, found):
        """The point off which rays start, the normal, and whether it is on a ball."""
        dr, mi = self.dr, self.mi
        place = dr.reinterpret_array(mi.UInt32, found.shape)
        x, y, z, radius = dr.gather(mi.Vector4f, self.rows, place, found.is_valid())
        p, ball = ray(found.t), radius > 0
        n = dr.select(ball, mi.Vector3f(p - mi.Point3f(x, y, z)) / radius, mi.Vector3f(0, 1, 0))
        n = dr.select(dr.dot(n, ray.d) > 0, -n, n)
        # As Mitsuba keeps rays off what they start on
        off = mi.math.RayEpsilon * (1 + dr.max(dr.abs(p)))
        return mi.Point3f(p + off * n), n, ball

    def lit(self, p, n, ball, d, active):
        """The light that a point sends back."""
        dr, mi, loaded = self.dr, self.mi, self.loaded
        mirror, ground = loaded["materials"]["mirror"], loaded["materials"]["ground"]
        color = dr.select(ball, mi.Color3f(mirror["color"]), mi.Color3f(ground["color"]))
        result = mi.Color3f(loaded["ambient"]) * color
        for light in loaded["lights"]:
            to = mi.Point3f(light["position"]) - p
            far = dr.norm(to)
            way = to / far
            lambert, shine = dr.dot(n, way), dr.dot(n, dr.normalize(way - d))
            open_ = active & (lambert > 0)
            shadow = mi.Ray3f(p, way)
            shadow.maxt = far
            open_ &= ~self.scene.ray_test(shadow, open_)
            spot = mirror["specular"] * dr.power(
                dr.select(shine > 0, shine, 1), mirror["shininess"]
            )
            spot = dr.select(ball & (shine > 0), spot, 0)
            light = mi.Color3f(light["intensity"]) * (color * lambert + spot)
            result += dr.select(open_, light, 0)
        return result

    def image(self):
        """The picture, flat: a generation of rays at a time, packed densely.

        One kernel, with a loop or unrolled, took three times longer.
        """
        dr, mi, loaded = self.dr, self.mi, self.loaded
        ray, place = self.rays()
        image, weight = dr.zeros(mi.Float, 3 * dr.width(place)), 1.0
        for depth in range(loaded.get("max_depth", 5)):
            found = self.scene.ray_intersect_preliminary(ray, coherent=depth == 0)
            hit = found.is_valid()
            p, n, ball = self.surface(ray, found)
            light = dr.select(
                hit, self.lit(p, n, ball, ray.d, hit), mi.Color3f(loaded["background"])
            )
            for c in range(3):
                dr.scatter_add(image, weight * light[c], 3 * place + c)
            d = mi.Vector3f(ray.d - 2 * dr.dot(ray.d, n) * n)
            dr.eval(image, p, d, ball)
            chosen = dr.compress(hit & ball)
            if not dr.width(chosen):
                break
            ray = mi.Ray3f(*(dr.gather(type(v), v, chosen) for v in (p, d)))
            place = dr.gather(mi.UInt32, place, chosen)
            weight *= loaded["materials"]["mirror"]["reflection"]
        dr.eval(image)
        dr.sync_thread()
        return image


if __name__ == "__main__":
    common.serve(lambda: Embree(common.scene(sys.argv[1])))
