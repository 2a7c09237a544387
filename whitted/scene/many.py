"""The spheres of a scene that a tree finds: those of clouds, and single ones if there are many."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np

from ..core.arrays import Array, Precision
from ..core.host import to_lanes
from ..core.parameter import ANY, Numbers, Parameter, Scale
from ..shapes import Shape, Sphere
from ..shapes.hierarchy import Hierarchy, build, moved
from ..shapes.places import PlacesOfMany
from ..shapes.sphere import NEAR
from .cloud import Cloud
from .parameters import Location

if TYPE_CHECKING:
    from .contents import Contents

# More single spheres than this go into the tree. As code of their own they compile for longer
MOST_ALONE = 32
# What they are, for kernels
NUMBERS = Parameter(1, ANY, ANY, Scale(1, "one"), None, None, many=True)
# The names in kernels of what the tree is made of, and where that is
SPHERES, NODES, MATERIAL, SPECIAL = "many.spheres", "many.nodes", "many.material", "many.special"
OF_MANY = {
    name: Location("many", None, (name.partition(".")[2],), NUMBERS)
    for name in (SPHERES, NODES, MATERIAL, SPECIAL)
}


@dataclass(frozen=True)
class Source:
    """What spheres of the tree come from: a cloud, or a single sphere."""

    name: str  # the beginning of its parameters' names
    material: str
    first: int  # the number of its first sphere
    count: int

    @property
    def is_cloud(self) -> bool:
        return self.name.startswith("clouds.")

    @property
    def rows(self) -> slice:
        return slice(self.first, self.first + self.count)


def sources_of(shapes: Iterable[Shape], clouds: Iterable[Cloud]) -> tuple[Source, ...]:
    """Where the spheres of the tree come from, in the order of their numbers."""
    spheres = [shape for shape in shapes if isinstance(shape, Sphere)]
    things: list[Any] = [*(spheres if len(spheres) > MOST_ALONE else ()), *clouds]
    sources, first = [], 0
    for thing in things:
        count = dr.width(thing.radius)
        if count:
            sources.append(Source(f"{thing.group}.{thing.name}", thing.material, first, count))
            first += count
    return tuple(sources)


@dataclass(frozen=True)
class Many:
    """The numbers of the spheres, and their tree."""

    spheres: np.ndarray  # (N, 4): centers and radii
    hierarchy: Hierarchy
    arrays: dict[str, Array]  # for kernels


def many_of(scene: "Contents", before: Many | None) -> Many:
    """The numbers of a scene's spheres, and their tree.

    Args:
        before: those from before some numbers changed.
    """
    spheres = _numbers_of(scene)
    if before is not None and np.array_equal(spheres, before.spheres):
        return before
    members = _met(spheres, scene)
    tree = build(spheres, members) if before is None else moved(before.hierarchy, spheres, members)
    arrays = {SPHERES: to_lanes(spheres.ravel()), NODES: to_lanes(tree.records.ravel())}
    arrays[MATERIAL] = to_lanes(_materials_of(scene)) if before is None else before.arrays[MATERIAL]
    return Many(spheres, tree, arrays)


def _numbers_of(scene: "Contents") -> np.ndarray:
    """(N, 4): the centers and radii of all spheres of the tree."""
    numbers = scene.numbers
    if not any(source.is_cloud for source in scene.sources):
        rows: Any = [
            (*numbers[f"{source.name}.center"], *numbers[f"{source.name}.radius"])
            for source in scene.sources
        ]
        return np.array(rows, scene.precision.dtype)
    spheres = np.empty((scene.sources[-1].rows.stop, 4), scene.precision.dtype)
    for source in scene.sources:
        spheres[source.rows, :3] = numbers[f"{source.name}.center"]
        spheres[source.rows, 3] = numbers[f"{source.name}.radius"]
    return spheres


def materials_of_many(sources: Iterable[Source]) -> tuple[str, ...]:
    """The names of the materials, by number."""
    return tuple(dict.fromkeys(source.material for source in sources))


def _materials_of(scene: "Contents") -> np.ndarray:
    """The number of each sphere's material."""
    numbers = {name: k for k, name in enumerate(materials_of_many(scene.sources))}
    own = [numbers[source.material] for source in scene.sources]
    return np.repeat(np.array(own, np.uint32), [source.count for source in scene.sources])


def _met(spheres: np.ndarray, scene: "Contents") -> np.ndarray:
    """The numbers of the spheres that coincide with no earlier one, nor with one outside."""
    # Of equal numbers all bits are equal, but for the two zeros
    words = np.ascontiguousarray(spheres + 0).view(np.uint32).astype(np.uint64)
    factors = np.arange(1, 2 * words.shape[1], 2, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    hashes = (words * factors).sum(1)
    kept = np.ones(len(spheres), bool)
    ordered = np.sort(hashes)
    repeated = ordered[1:][ordered[1:] == ordered[:-1]]
    if repeated.size:
        seen = set()
        for k in np.flatnonzero(np.isin(hashes, repeated)):
            row = tuple(spheres[k].tolist())
            kept[k] = row not in seen
            seen.add(row)
    numbers = scene.numbers
    for shape in scene.singles:
        if isinstance(shape, Sphere):
            name = f"spheres.{shape.name}"
            own = *numbers[f"{name}.center"], *numbers[f"{name}.radius"]
            kept &= (spheres != np.array(own, spheres.dtype)).any(1)
    return np.flatnonzero(kept)


def places_of_many(
    spheres: np.ndarray, eye: Numbers, lights: Sequence[Numbers | None], precision: Precision
) -> tuple[PlacesOfMany, np.ndarray]:
    """Facts about where the spheres are, and for each a bit for the eye and for each light of the
    facts that is exactly on it.
    """
    columns = np.ascontiguousarray(spheres.T)
    near = _from_surface(columns, eye) < NEAR[precision.name] * columns[3]
    compensated = bool(near.any())
    on_eye = _holding(columns, eye, precision)
    on_lights = {
        k: on
        for k, light in enumerate(lights)
        if light is not None and (on := _holding(columns, light, precision)).size
    }
    special = np.zeros(len(spheres), np.uint32)
    for bit, on in enumerate((on_eye, *on_lights.values())):
        special[on] |= np.uint32(1 << bit)
    return PlacesOfMany(compensated, bool(on_eye.size), tuple(on_lights)), special


def _from_surface(columns: np.ndarray, point: Numbers) -> np.ndarray:
    """How far a point is from the surface of each sphere.

    Args:
        columns: (4, N), centers and radii: sums along a short last axis are slow.
    """
    x, y, z = (own - np.float64(number) for own, number in zip(columns[:3], point, strict=True))
    distance: np.ndarray = np.abs(np.sqrt(x * x + y * y + z * z) - columns[3])
    return distance


def _holding(columns: np.ndarray, point: Numbers, precision: Precision) -> np.ndarray:
    """The numbers of the spheres that a point is exactly on."""
    distance, most = _from_surface(columns, point), 8 * precision.epsilon
    beyond = np.abs(point).max()
    # Few are as close as the largest of all numbers allows
    close = np.flatnonzero(distance <= most * max(np.abs(columns).max(), beyond))
    largest = np.maximum(np.abs(columns[:, close]).max(0), beyond)
    exactly = [
        k
        for k in close[distance[close] <= most * largest]
        if Sphere.passes_through(
            point, precision, tuple(columns[:3, k].tolist()), (columns[3, k].item(),)
        )
    ]
    return np.array(exactly, int)


def attached_spheres(scene: "Contents", spheres: Array) -> Array:
    """The spheres' numbers, attached to the gradients of the parameters that they come from."""
    real, moving = type(spheres), None
    for source in scene.sources:
        center, radius = (
            scene.locations[f"{source.name}.{field}"].read(scene) for field in ("center", "radius")
        )
        for k, part in enumerate((*center, radius)):
            if dr.grad_enabled(part):
                moving = dr.zeros(real, dr.width(spheres)) if moving is None else moving
                place = dr.arange(dr.uint32_array_t(real), source.count) + source.first
                dr.scatter(moving, part, 4 * place + k)
    return spheres if moving is None else dr.replace_grad(spheres, moving)
