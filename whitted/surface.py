"""What a ray meets: the point, the normal, the material, and the media on both sides."""

from dataclasses import dataclass

import drjit as dr

from .geometry import NONE, Array, Plane, Ray, Sphere, level
from .scene import Hit, Material, Scene, starts_on


@dataclass(frozen=True)
class Surface:
    p: Array  # the point that the ray reaches
    n: Array  # the unit normal there, turned towards the side that the ray came from
    hit: Hit
    hits: Array  # Bool: there is a surface
    of: dict[str, Array]  # material name to Bool: the surface is of this material


def surface(scene: Scene, ray: Ray, hit: Hit) -> Surface:
    """The surface at a hit, differentiable in the scene and the ray although the hit itself is detached.

    The distance is the root of a level function F(o + t d) = 0, so its derivative is -dF / (grad F . d) (the implicit
    function theorem): one primitive's parameters enter, however many the search looked at.
    """
    is_sphere = hit.index < len(scene.spheres)
    hits = hit.index != NONE
    p = dr.fma(ray.d, dr.select(hits, hit.t, 1), ray.o)
    center, normal = type(p)(0), -dr.detach(ray.d)
    for k, sphere in enumerate(scene.spheres):
        center = dr.select(hit.index == k, sphere.center, center)
    for k, plane in enumerate(scene.planes, len(scene.spheres)):
        normal = dr.select(hit.index == k, plane.normal, normal)
    if dr.grad_enabled(ray, scene):
        p = _attach_distance(scene, ray, hit, p, center, normal)
    flip = dr.select(is_sphere, hit.inside, dr.dot(dr.detach(normal), dr.detach(ray.d)) > 0)
    outward = dr.select(is_sphere, p - center, normal)
    n = dr.mulsign(dr.normalize(outward), dr.select(flip, -dr.ones(dr.value_t(type(p))), 1))
    return Surface(p, n, hit, hits, _material_masks(scene, hit))


def _attach_distance(scene: Scene, ray: Ray, hit: Hit, p: Array, center: Array, normal: Array) -> Array:
    """The point p, moved along the ray by the (zero) Newton step that carries the distance's derivative."""
    is_sphere, real = hit.index < len(scene.spheres), dr.value_t(type(p))
    radius, offset = real(0), real(0)
    for k, sphere in enumerate(scene.spheres):
        radius = dr.select(hit.index == k, sphere.radius, radius)
    for k, plane in enumerate(scene.planes, len(scene.spheres)):
        offset = dr.select(hit.index == k, plane.offset, offset)
    outward = p - center
    f = dr.select(is_sphere, (dr.squared_norm(outward) - radius * radius) / 2, dr.dot(normal, p) + offset)
    slope = dr.dot(dr.detach(dr.select(is_sphere, outward, normal)), dr.detach(ray.d))
    step = (dr.detach(f) - f) / dr.select(slope == 0, 1, slope)
    return p + dr.select(hit.index != NONE, step, 0) * dr.detach(ray.d)


def _material_masks(scene: Scene, hit: Hit) -> dict[str, Array]:
    of: dict[str, Array] = {}
    for k in range(len(scene.spheres) + len(scene.planes)):
        name, here = scene.material_of(k), hit.index == k
        of[name] = of[name] | here if name in of else here
    return of


def any_of(scene: Scene, at: Surface, wanted) -> Array:
    """Whether the surface is of one of the materials that `wanted` (Material -> bool) accepts."""
    mask = dr.mask_t(at.hit.t)(False)
    for material in scene.used:
        if wanted(material):
            mask |= at.of[material.name]
    return mask


def lookup(scene: Scene, at: Surface, field: str, wanted) -> Array:
    """A field of the surface's material, and 0 where it is not of one of the materials that are `wanted`."""
    kind = type(at.p) if field == "color" else dr.value_t(type(at.p))
    value = kind(0)
    for material in scene.used:
        if wanted(material):
            value = dr.select(at.of[material.name], getattr(material, field), value)
    return value


def albedo(scene: Scene, at: Surface) -> Array:
    """The surface's Lambertian albedo, with its checkerboard."""
    color = lookup(scene, at, "color", lambda m: scene.may(m, "color"))
    materials = {material.name: material for material in scene.used}
    for k, plane in enumerate(scene.planes, len(scene.spheres)):
        checker = materials[plane.material].checker
        if checker is not None:
            u, v = on_plane(dr.detach(at.p), dr.detach(plane.normal))
            cells = dr.floor(u / checker.size) + dr.floor(v / checker.size)
            odd = cells - 2 * dr.floor(cells / 2) != 0
            color = dr.select((at.hit.index == k) & odd, type(color)(*checker.color), color)
    return color


def on_plane(p: Array, normal: Array) -> tuple[Array, Array]:
    """u and v on a plane: the coordinates of p off the normal's largest axis."""
    size_x, size_y, size_z = abs(normal.x), abs(normal.y), abs(normal.z)
    drop_x = (size_x >= size_y) & (size_x >= size_z)
    drop_y = ~drop_x & (size_y >= size_z)
    return dr.select(drop_x, p.y, p.x), dr.select(drop_x | drop_y, p.z, p.y)


def checkers(scene: Scene) -> list[tuple[int, Plane, float]]:
    """The planes with a checkerboard, with their place among the primitives and the size of a cell."""
    materials = {material.name: material for material in scene.used}
    planes = [(k, plane, materials[plane.material].checker) for k, plane in enumerate(scene.planes, len(scene.spheres))]
    return [(k, plane, checker.size) for k, plane, checker in planes if checker is not None]


def transparent(scene: Scene) -> list[tuple[int, Sphere, Material]]:
    """The spheres that can fill space, with their place among the primitives."""
    materials = {material.name: material for material in scene.used}
    spheres = [(k, sphere, materials[sphere.material]) for k, sphere in enumerate(scene.spheres)]
    return [(k, sphere, material) for k, sphere, material in spheres if scene.may(material, "refraction")]


def relative_index(scene: Scene, at: Surface) -> Array:
    """eta = n_incident / n_transmitted: a point is in the smallest transparent sphere that contains it."""
    clear = transparent(scene)
    real, index, inside = dr.value_t(type(at.p)), at.hit.index, at.hit.inside
    own_ior, own_radius, own = real(1), real(dr.inf), dr.mask_t(at.hit.t)(False)
    for k, sphere, material in clear:
        here = (index == k) & (material.refraction != 0)
        own_ior, own = dr.select(here, material.ior, own_ior), own | here
        own_radius = dr.select(here, dr.detach(sphere.radius), own_radius)
    if len(clear) == 1:
        return dr.select(inside, own_ior, 1) / dr.select(inside, 1, own_ior)

    # The smallest of the other spheres around the point
    outer_ior, outer_radius, outer = real(1), real(dr.inf), dr.uint32_array_t(real)(NONE)
    p = dr.detach(at.p)
    for k, sphere, material in clear:
        detached = dr.detach(sphere)
        around = (level(detached, p) < 0) & ~starts_on(scene, index, k) & (material.refraction != 0)
        around &= detached.radius < outer_radius
        outer_radius, outer = dr.select(around, detached.radius, outer_radius), dr.select(around, k, outer)
        outer_ior = dr.select(around, material.ior, outer_ior)
    fills = own & ((own_radius < outer_radius) | ((own_radius == outer_radius) & (index < outer)))
    inner_ior = dr.select(fills, own_ior, outer_ior)
    return dr.select(inside, inner_ior, outer_ior) / dr.select(inside, outer_ior, inner_ior)
