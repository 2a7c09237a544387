"""Mitsuba 3 (LLVM) doing the same work, by an integrator in its Python interface.

The integrator follows both the reflected and the refracted ray. Shapes, hits and shadows are
Mitsuba's. Materials are tables, as Mitsuba has no plugin for them. Rays are traced a generation at
a time and packed densely: with an unrolled tree, one kernel compiled for minutes.
"""

import math

import common
import numpy as np

SIZE, DEPTH = 512, 5
# Half the side of the rectangles that stand for planes
FAR = 100


def load(mi, loaded: dict):
    """Mitsuba's scene: three spheres and five large rectangles, without materials or lights."""
    scene = {"type": "scene"}
    for k, sphere in enumerate(loaded["spheres"]):
        place = mi.ScalarTransform4f().translate(sphere["center"]).scale(sphere["radius"])
        scene[f"s{k}"] = {"type": "sphere", "to_world": place}
    for k, plane in enumerate(loaded["planes"]):
        n = np.array(plane["normal"], float)
        look = mi.ScalarTransform4f().look_at(
            origin=list(-n), target=[0, 0, 0], up=list(np.roll(n, 1))
        )
        scene[f"s{k + 3}"] = {"type": "rectangle", "to_world": look.scale(FAR)}
    return mi.load_dict(scene)


def integrator(mi, dr, loaded: dict):
    """The integrator's class. It is made in a function, as its base is known only with Mitsuba."""
    shapes = [*loaded["spheres"], *loaded["planes"]]
    materials = [loaded["materials"][shape["material"]] for shape in shapes]

    class Whitted(mi.SamplingIntegrator):
        def __init__(self, scene, parameters: dict) -> None:
            super().__init__(mi.Properties())
            self.parameters = parameters
            places = {shape.id(): k for k, shape in enumerate(scene.shapes())}
            order = [
                int(dr.reinterpret_array(mi.UInt32, scene.shapes_dr())[places[f"s{k}"]])
                for k in range(len(shapes))
            ]
            self.weights = [
                self.spread(order, [m.get(field, 0) for m in materials])
                for field in ("reflection", "refraction")
            ]
            self.colors = [
                self.spread(order, [m.get("color", [0, 0, 0])[c] for m in materials])
                for c in range(3)
            ]
            self.index = mi.UInt32(self.spread(order, range(len(shapes))))

        def spread(self, order: list[int], numbers) -> object:
            """Numbers of the shapes, in the order of Mitsuba's registry."""
            spread = np.zeros(max(order) + 1, np.float32)
            spread[order] = list(numbers)
            return mi.Float(spread)

        def vector(self, name: str):
            return mi.Vector3f(
                *[dr.gather(mi.Float, self.parameters[name], mi.UInt32(k)) for k in range(3)]
            )

        def lit(self, scene, si, n, d, shape):
            """The light that surfaces reflect diffusely and in highlights."""
            to = self.vector("lights.light0.position") - si.p
            light = dr.normalize(to)
            lambert, shine = dr.dot(n, light), dr.dot(n, dr.normalize(light - d))
            lit = si.is_valid() & (lambert > 0)
            lit &= ~scene.ray_test(dr.detach(si.spawn_ray_to(dr.detach(si.p + to))), lit)
            color = mi.Color3f(*[dr.gather(mi.Float, c, shape) for c in self.colors])
            spot = dr.select(
                shine > 0, 0.3 * dr.power(dr.select(lit & (shine > 0), shine, 1), 50.0), 0
            )
            return dr.select(
                lit,
                mi.Color3f(self.vector("lights.light0.intensity")) * (color * lambert + spot),
                0,
            )

        def trace(self, scene, o, d, weight, place, image, depth: int) -> None:
            """Add a generation's light to its pixels, then trace what it reflects and refracts."""
            si = scene.ray_intersect(
                mi.Ray3f(mi.Point3f(o), d), mi.RayFlags.All, coherent=depth == 1
            )
            shape = dr.select(si.is_valid(), dr.reinterpret_array(mi.UInt32, si.shape), 0)
            inside = dr.dot(dr.detach(si.n), dr.detach(d)) > 0
            n = dr.select(si.is_valid(), dr.select(inside, -si.n, si.n), mi.Normal3f(0, 1, 0))
            light = weight * self.lit(scene, si, n, d, shape)
            for c in range(3):
                dr.scatter_add(image, light[c], 3 * place + c)
            if depth == DEPTH:
                return
            reflection, refraction = (
                dr.gather(mi.Float, table, shape, si.is_valid()) for table in self.weights
            )
            index = dr.gather(
                mi.Float,
                self.parameters["ior"],
                dr.minimum(dr.gather(mi.UInt32, self.index, shape), 2),
            )
            eta, cosine = dr.select(inside, index, 1 / index), -dr.dot(n, d)
            k = 1 - eta * eta * (1 - cosine * cosine)
            total = (refraction > 0) & (k <= 0)
            reflection, refraction = (
                dr.select(total, reflection + refraction, reflection),
                dr.select(total, 0, refraction),
            )
            mirrored = d + 2 * cosine * n
            bent = eta * d + (eta * cosine - dr.sqrt(dr.select(refraction > 0, k, 1))) * n
            children = (mirrored, reflection), (bent, refraction)
            starts = [
                (mi.Vector3f(si.spawn_ray(direction).o), direction, weight * part)
                for direction, part in children
            ]
            dr.eval(starts, place, reflection, refraction)
            for (origin, direction, share), (_, part) in zip(starts, children, strict=True):
                chosen = dr.compress(part > 0)
                if dr.width(chosen):
                    packed = [
                        dr.gather(type(value), value, chosen)
                        for value in (origin, direction, share, place)
                    ]
                    self.trace(scene, *packed, image, depth + 1)

    return Whitted


class Mitsuba(common.Peer):
    """The image, of one ray through each pixel's centre, and its gradient by plain AD."""

    def __init__(self) -> None:
        import drjit as dr
        import mitsuba as mi

        mi.set_variant("llvm_ad_rgb")
        self.dr, self.mi, self.step = dr, mi, 0
        loaded = common.scene()
        self.scene = load(mi, loaded)
        self.traversed = mi.traverse(self.scene)
        self.type = integrator(mi, dr, loaded)

    def changed(self) -> dict:
        """The parameters, one of them a little moved each time."""
        self.step += 1
        values = {name: self.mi.Float(numbers) for name, numbers in common.values().items()}
        values["spheres.sphere0.center"] += 1e-6 * self.step
        self.dr.eval(values)
        return values

    def ray(self, camera):
        """Directions of the rays through the pixels' centres, and their pixels.

        Blocks of 4 x 4 pixels are neighbours in memory.
        """
        dr, mi = self.dr, self.mi
        i = dr.arange(mi.UInt32, SIZE * SIZE)
        block, lane = i // 16, i % 16
        x, y = block % (SIZE // 4) * 4 + lane % 4, block // (SIZE // 4) * 4 + lane // 4
        forward = dr.normalize(-camera)
        right = dr.normalize(dr.cross(forward, mi.Vector3f(0, 1, 0)))
        up = dr.cross(right, forward)
        scale = math.tan(math.radians(53.130102354 / 2))
        u, v = (
            (2 * (mi.Float(x) + 0.5) / SIZE - 1) * scale,
            (1 - 2 * (mi.Float(y) + 0.5) / SIZE) * scale,
        )
        return dr.normalize(forward + u * right + v * up), y * SIZE + x

    def render(self, values: dict):
        """The image as a flat array."""
        dr, mi = self.dr, self.mi
        for k in range(3):
            center, radius = (
                values[f"spheres.sphere{k}.center"],
                values[f"spheres.sphere{k}.radius"],
            )
            center = mi.Point3f(*[dr.gather(mi.Float, center, mi.UInt32(c)) for c in range(3)])
            self.traversed[f"s{k}.to_world"] = (
                mi.AffineTransform4f().translate(center).scale(radius)
            )
        self.traversed.update()
        ior = dr.zeros(mi.Float, 3)
        for k, name in enumerate(common.MATERIALS):
            ior += dr.select(dr.arange(mi.UInt32, 3) == k, values[name], 0)
        method = self.type(self.scene, values | {"ior": ior})
        camera = method.vector("camera.position")
        d, place = self.ray(camera)
        image = dr.zeros(mi.Float, 3 * SIZE * SIZE)
        method.trace(
            self.scene, camera + dr.zeros(mi.Vector3f, dr.width(d)), d, mi.Float(1), place, image, 1
        )
        return image

    def image(self):
        image = self.render(self.changed())
        self.dr.eval(image)
        self.dr.sync_thread()
        return image.numpy().reshape(SIZE, SIZE, 3)

    def gradient(self, loss=None) -> list[float]:
        dr, values = self.dr, self.changed()
        dr.enable_grad(values)
        image = self.render(values)
        dr.backward(loss(image) if loss else dr.mean(dr.square(image)))
        return common.flat(dr.grad(values))

    def sums(self) -> dict[str, float]:
        found = self.gradient(self.dr.sum)
        return {name: found[place] for name, place in common.PROBES.items()}


if __name__ == "__main__":
    common.serve(Mitsuba)
