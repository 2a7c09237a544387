"""The contract's equations once more, one ray at a time in NumPy's float64: what the renderer is
held against.

Written from the equations, not from `whitted`, and with none of its shortcuts.
"""

import math
import sys

import numpy as np

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

# How far the renderer may be from it in double precision. A curved surface magnifies a rounding,
# 2e-16, about tenfold, and what comes after four of them weighs little
ERROR = 2e-12

MATERIAL = {
    "color": [0, 0, 0],
    "specular": 0,
    "shininess": 50,
    "reflection": 0,
    "refraction": 0,
    "ior": 1.5,
    "shadow": 1,
    "fresnel": False,
}


def unit(v):
    return np.array(v, float) / np.linalg.norm(v)


class Reference:
    """A scene file's text, made ready to trace."""

    def __init__(self, text):
        raw = tomllib.loads(text)
        self.camera = {"up": [0, 1, 0], **raw["camera"]}
        self.background = np.array(raw.get("background", [0, 0, 0]), float)
        self.ambient = np.array(raw.get("ambient", [0, 0, 0]), float)
        self.max_depth = raw.get("max_depth", 5)
        self.min_importance = raw.get("min_importance", 0)
        materials = {name: {**MATERIAL, **m} for name, m in raw.get("materials", {}).items()}
        self.lights = raw.get("lights", [])
        # Spheres come first, then planes, then discs, each in the order of the file
        self.primitives = []
        for kind in ("sphere", "plane", "disc"):
            for x in raw.get(f"{kind}s", []):
                self.primitives.append({"kind": kind, **x, **materials[x["material"]]})

    def image(self, spp=1):
        """The picture, of shape (height, width, 3)."""
        width, height = self.camera["resolution"]
        side = math.isqrt(spp)
        places = [((i + 0.5) / side, (j + 0.5) / side) for j in range(side) for i in range(side)]
        pixels = [
            [np.mean([self.pixel(x + a, y + b) for a, b in places], 0) for x in range(width)]
            for y in range(height)
        ]
        return np.array(pixels)

    def pixel(self, x, y):
        """What the camera sees at an image position."""
        width, height = self.camera["resolution"]
        eye = np.array(self.camera["position"], float)
        f = unit(np.array(self.camera["look_at"], float) - eye)
        right = unit(np.cross(f, self.camera["up"]))
        tan = math.tan(math.radians(self.camera["fov"]) / 2)
        d = (
            f
            + (2 * x / width - 1) * tan * width / height * right
            + (1 - 2 * y / height) * tan * np.cross(right, f)
        )
        return self.radiance(eye, unit(d))

    def crossings(self, o, d, source, inward):
        """Every (distance, primitive, from within) of the ray's line in front of it, without the
        surface that it starts on.
        """
        for k, x in enumerate(self.primitives):
            if x["kind"] != "sphere":
                n = unit(x["normal"])
                offset = x["offset"] if x["kind"] == "plane" else -n @ x["center"]
                t = -(n @ o + offset) / (n @ d) if n @ d != 0 else -1
                if k != source and t > 0 and self.reaches(x, o + t * d):
                    yield t, k, False
                continue
            v = np.array(x["center"], float) - o
            b, discriminant = v @ d, (v @ d) ** 2 - v @ v + x["radius"] ** 2
            if k == source:
                yield from [(2 * b, k, True)] if inward else []
            elif discriminant > 0:
                roots = b - math.sqrt(discriminant), b + math.sqrt(discriminant)
                yield from ((t, k, roots[0] < 0) for t in roots if t > 0)

    def reaches(self, x, p):
        """Whether a flat primitive goes as far as a point of its plane."""
        return x["kind"] == "plane" or np.linalg.norm(p - x["center"]) < x["radius"]

    def media(self, p, k):
        """The indices of refraction just outside and just inside the sphere k at p; for a plane, of
        both its sides.
        """
        spheres = [(i, x) for i, x in enumerate(self.primitives) if x["kind"] == "sphere"]
        clear = [(x["radius"], i, x["ior"]) for i, x in spheres if x["refraction"] > 0]
        around = [
            c
            for c in clear
            if c[1] != k and np.linalg.norm(p - self.primitives[c[1]]["center"]) < c[0]
        ]
        own = [c for c in clear if c[1] == k]
        return [min(candidates)[2] if candidates else 1 for candidates in (around, around + own)]

    def weights(self, x, c, media):
        """At an angle of cosine c: the weights of the mirrored and the refracted ray, eta, k."""
        eta = media[0] / media[1]
        k = 1 - eta**2 * (1 - c**2)
        if k <= 0:
            return x["reflection"] + (0 if x["fresnel"] else x["refraction"]), 0, eta, k
        if not x["fresnel"]:
            return x["reflection"], x["refraction"], eta, k
        (n_i, n_t), cos_t = media, math.sqrt(k)
        perpendicular = (n_i * c - n_t * cos_t) / (n_i * c + n_t * cos_t)
        parallel = (n_t * c - n_i * cos_t) / (n_t * c + n_i * cos_t)
        reflectance = 0 if n_i == n_t else (perpendicular**2 + parallel**2) / 2
        return x["reflection"] * reflectance, x["refraction"] * (1 - reflectance), eta, k

    def albedo(self, x, p):
        if "checker" not in x:
            return np.array(x["color"], float)
        u, v = np.delete(p, np.argmax(np.abs(x["normal"])))
        size = x["checker"]["size"]
        return np.array(x["checker"]["color"] if (u // size + v // size) % 2 else x["color"], float)

    def radiance(self, o, d, depth=1, weight=1.0, source=None, inward=False):
        """L(ray, depth)."""
        hit = min(self.crossings(o, d, source, inward), default=None)
        if hit is None:
            return self.background
        t, k, inside = hit
        x, p = self.primitives[k], o + t * d
        n = unit(p - x["center"]) if x["kind"] == "sphere" else unit(x["normal"])
        n = -n if d @ n > 0 else n
        result = self.ambient * self.albedo(x, p) + sum(
            (self.lit(x, p, n, d, light, k, inside) for light in self.lights), 0
        )
        if depth == self.max_depth:
            return result
        c, (outside, within) = -d @ n, self.media(p, k)
        media = (within, outside) if inside else (outside, within)
        if x["fresnel"] and x["refraction"] == 0:
            # What is opaque and polished: the medium around it, and its own index
            media = outside, x["ior"]
        w_r, w_t, eta, square = self.weights(x, c, media)
        if w_r and weight * w_r >= self.min_importance:
            result = result + w_r * self.radiance(
                p, d - 2 * (d @ n) * n, depth + 1, weight * w_r, k, inside
            )
        if w_t and weight * w_t >= self.min_importance:
            bent = eta * d + (eta * c - math.sqrt(square)) * n
            result = result + w_t * self.radiance(
                p, bent, depth + 1, weight * w_t, k, x["kind"] == "sphere" and not inside
            )
        return result

    def lit(self, x, p, n, d, light, k, inside):
        """What a light adds."""
        if light.get("type") == "directional":
            distance, to_light, strength = (
                math.inf,
                -unit(light["direction"]),
                np.array(light["irradiance"]),
            )
        else:
            offset = np.array(light["position"], float) - p
            distance, to_light, strength = (
                np.linalg.norm(offset),
                unit(offset),
                np.array(light["intensity"]),
            )
            if light.get("falloff") == "inverse-square":
                strength = strength / distance**2
        if n @ to_light <= 0:
            return 0
        crossed = {i for t, i, _ in self.crossings(p, to_light, k, inside) if t < distance}
        passed = math.prod(1 - self.primitives[i]["shadow"] for i in crossed)
        h = max(0, n @ unit(to_light - d)) ** x["shininess"]
        return passed * strength * (self.albedo(x, p) * (n @ to_light) + x["specular"] * h)
