"""The yardstick's scene in Taichi: a loop over pixels, each with a stack of rays of its own."""

import taichi as ti

SIZE, DEPTH, SPHERES, SHAPES = 512, 5, 3, 8
FAR, NONE = 1e30, -1
Vector, Array = ti.types.vector(3, float), ti.types.ndarray(ti.f32, 2)
Ray = ti.types.struct(o=Vector, d=Vector, weight=float, source=int, inward=int, depth=int)


@ti.func
def row(numbers: ti.template(), k: int, first: int):
    return Vector(numbers[k, first], numbers[k, first + 1], numbers[k, first + 2])


@ti.func
def along(shapes: ti.template(), k: int, o, d, source: int, inward: int):
    """The distance to a sphere, or FAR."""
    to = row(shapes, k, 0) - o
    b = to.dot(d)
    q = to - b * d
    inside = shapes[k, 3] ** 2 - q.dot(q)
    found = FAR
    if inside > 0 and (source != k or inward):
        half = ti.sqrt(inside)
        t = b - half
        if source == k or t <= 0:
            t = b + half
        if t > 0:
            found = t
    return found


@ti.func
def closest(shapes: ti.template(), ray):
    """The nearest shape and its distance."""
    index, best = NONE, FAR
    for k in ti.static(range(SHAPES)):
        t = FAR
        if ti.static(k < SPHERES):
            t = along(shapes, k, ray.o, ray.d, ray.source, ray.inward)
        else:
            # No ray starts on a plane, as none reflects
            n = row(shapes, k, 0)
            t = -(ray.o.dot(n) + shapes[k, 3]) / ray.d.dot(n)
        if 0 < t < best:
            best, index = t, k
    return index, best


@ti.func
def lit(view: ti.template(), shapes: ti.template(), k: int, p, n, d, inside: int):
    """The light that a point sends back. Planes bound a convex room and throw no shadows."""
    result = Vector(0)
    to = row(view, 4, 0) - p
    far = to.norm()
    way = to / far
    lambert = n.dot(way)
    if lambert > 0:
        blocked = False
        for j in ti.static(range(SPHERES)):
            if not blocked:
                blocked = along(shapes, j, p, way, k, inside) < far
        if not blocked:
            shine = n.dot((way - d).normalized())
            spot = 0.0
            if shine > 0:
                spot = shapes[k, 7] * shine ** shapes[k, 8]
            result = row(view, 5, 0) * (row(shapes, k, 4) * lambert + spot)
    return result


@ti.kernel
def trace(view: Array, shapes: Array, picture: ti.types.ndarray(Vector, 2)):
    """Make the picture. The rows of `view` and of `shapes` are as in simd.cpp."""
    for y, x in ti.ndrange(SIZE, SIZE):
        u, v = 2 * (x + 0.5) / SIZE - 1, 1 - 2 * (y + 0.5) / SIZE
        d = (row(view, 1, 0) + u * row(view, 2, 0) + v * row(view, 3, 0)).normalized()
        ray = Ray(row(view, 0, 0), d, 1.0, NONE, 0, 1)
        # Refracted rays wait on the stack; a reflected ray goes on at once
        total, waiting, going = Vector(0), 0, True
        stack = ti.Matrix.zero(float, DEPTH, 10)
        while going:
            k, t = closest(shapes, ray)
            going = False
            if k != NONE:
                p, n = ray.o + t * ray.d, row(shapes, k, 0)
                if k < SPHERES:
                    n = (p - n) / shapes[k, 3]
                inside = n.dot(ray.d) > 0
                if inside:
                    n = -n
                total += ray.weight * lit(view, shapes, k, p, n, ray.d, inside)
                reflection, refraction = shapes[k, 9], shapes[k, 10]
                if ray.depth < DEPTH and reflection + refraction > 0:
                    c, eta = -n.dot(ray.d), 1 / shapes[k, 11]
                    if inside:
                        eta = shapes[k, 11]
                    root = 1 - eta * eta * (1 - c * c)
                    if root <= 0:
                        reflection, refraction = reflection + refraction, 0.0
                    if refraction > 0:
                        bent = eta * ray.d + (eta * c - ti.sqrt(root)) * n
                        for i in ti.static(range(3)):
                            stack[waiting, i], stack[waiting, 3 + i] = p[i], bent[i]
                        stack[waiting, 6] = ray.weight * refraction
                        stack[waiting, 7], stack[waiting, 8] = k, not inside
                        stack[waiting, 9] = ray.depth + 1
                        waiting += 1
                    if reflection > 0:
                        mirrored, weight = ray.d + 2 * c * n, ray.weight * reflection
                        ray = Ray(p, mirrored, weight, k, inside, ray.depth + 1)
                        going = True
            if not going and waiting > 0:
                waiting -= 1
                s = [stack[waiting, i] for i in ti.static(range(10))]
                o, d = Vector(s[0], s[1], s[2]), Vector(s[3], s[4], s[5])
                ray = Ray(o, d, s[6], ti.cast(s[7], int), ti.cast(s[8], int), ti.cast(s[9], int))
                going = True
        picture[y, x] = total
