"""What a scene holds, as kernels see it: its fields, and all that is derived from them."""

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import drjit as dr
import numpy as np

from ..core.arrays import Array, Parameters, Precision, precision_named, precision_of
from ..core.frozen import is_recording
from ..core.gathered import Gathered
from ..core.host import from_numbers, to_lanes, to_numbers
from ..core.packed import packed
from ..core.parameter import Numbers, parameters_of
from ..core.pytree import Apart, put_together, take_apart
from ..lights import Light
from ..shapes import SHAPES, Shape
from ..shapes.many import FIRST, ManySpheres
from ..shapes.places import PlacesOfMany
from ..shapes.sets import sets_of
from .camera import Camera
from .cloud import Cloud
from .features import Features, features_of
from .many import (
    SPECIAL,
    SPHERES,
    Many,
    Source,
    attached_spheres,
    many_of,
    places_of_many,
    sources_of,
)
from .material import Material
from .parameters import Location, locations_in, numbers_of, with_values
from .structure import UP, Structure
from .surroundings import Surroundings

Own = TypeVar("Own", bound="Contents")


@dataclass(frozen=True, eq=False, init=False, repr=False, kw_only=True)
class Contents(Surroundings):
    """The fields of a `Scene`, whose constructors are in `scene.py`."""

    camera: Camera
    resolution: tuple[int, int]
    # By kind, in the order of `SHAPES`, then in that of the file
    shapes: tuple[Shape, ...]
    materials: tuple[Material, ...]
    lights: tuple[Light, ...]
    clouds: tuple[Cloud, ...]
    # In a kernel: the spheres that a tree finds, which are then not among shapes and clouds
    many: ManySpheres | None
    max_depth: int
    min_importance: float
    # The parameters with a neutral value that `replace` has changed
    touched: frozenset[str]
    # In a kernel: the features that it is compiled for
    fixed: Features | None
    # The file that it was read from, whose comments `save` keeps, and its folder; empty without one
    text: str
    folder: str

    def carrying(self: Own, values: Mapping[str, Array]) -> Own:
        """The scene with these arrays for its parameters, unchecked and of any width."""
        return self._with(**self._changes(values))

    def _changes(self, values: Mapping[str, Array]) -> dict[str, Any]:
        """The fields of the scene that hold other arrays than now, by the names of parameters."""
        fields: dict[str, dict[int | None, dict[tuple[str, ...], Array]]] = {}
        for name, value in values.items():
            where = self.locations[name]
            fields.setdefault(where.field, {}).setdefault(where.place, {})[where.path] = value
        return {field: self._changed(field, places) for field, places in fields.items()}

    def _changed(self, field: str, places: dict[int | None, Any]) -> Any:
        old = getattr(self, field)
        if isinstance(old, tuple):
            return tuple(with_values(x, places[k]) if k in places else x for k, x in enumerate(old))
        return places[None][()] if () in places[None] else with_values(old, places[None])

    def _with(self: Own, **changes: Any) -> Own:
        """A copy with these fields, which has the same parameters."""
        scene, own = object.__new__(type(self)), self.__dict__
        scene.__dict__.update({name: own[name] for name in FIELDS}, **changes)
        derived = ("locations", "neutral", "names_by_shape", "sources")
        scene.__dict__.update({name: getattr(self, name) for name in derived})
        return scene

    def __eq__(self, other: object) -> bool:
        """Whether another scene has the same objects, numbers, settings and precision."""
        if not isinstance(other, Contents):
            return NotImplemented
        if self._described != other._described:
            return False
        mine, others = self.numbers, other.numbers
        return all(np.array_equal(own, others[name]) for name, own in mine.items())

    def __hash__(self) -> int:
        return hash(self._described)

    @cached_property
    def _described(self) -> Hashable:
        """All of the scene but its numbers, and whether `replace` has touched them."""
        clouds = tuple(replace(cloud, file="") for cloud in self.clouds)
        described = replace(
            self, clouds=clouds, touched=frozenset(), fixed=None, text="", folder=""
        )
        return take_apart(described, []), self.precision.name

    def __reduce__(self) -> tuple[Any, ...]:
        """What is pickled: plain numbers, without gradients.

        Arrays would arrive in NumPy's memory, where kernels are slow.
        """
        arrays: list[Array] = []
        structure = take_apart(self, arrays)
        return _unpickled, (structure, [to_numbers(array) for array in arrays], self.precision.name)

    def __copy__(self: Own) -> Own:
        """The scene itself, as it does not change."""
        return self

    def __deepcopy__(self: Own, _: object) -> Own:
        return self

    @cached_property
    def locations(self) -> dict[str, Location]:
        """Where each parameter is, by name."""
        return dict(self._locations())

    def _locations(self) -> Iterator[tuple[str, Location]]:
        for kind in SHAPES:
            for place, shape in enumerate(self.shapes):
                if type(shape) is kind:
                    yield from locations_in(shape, f"{kind.group}.{shape.name}", "shapes", place)
        for field in ("clouds", "materials", "lights"):
            for place, thing in enumerate(getattr(self, field)):
                yield from locations_in(thing, f"{field}.{thing.name}", field, place)
        yield from locations_in(self.camera, "camera", "camera")
        for field, entry in parameters_of(type(self)).items():
            yield field, Location(field, None, (), entry)

    @cached_property
    def neutral(self) -> dict[str, Numbers]:
        """The neutral values of the parameters that have one, by name."""
        entries = ((name, where.entry) for name, where in self.locations.items())
        return {
            name: (entry.neutral,) * entry.size
            for name, entry in entries
            if entry.neutral is not None
        }

    @cached_property
    def names_by_shape(self) -> tuple[tuple[str, ...], ...]:
        """The names of the parameters of each of `singles`."""
        return tuple(
            tuple(f"{shape.group}.{shape.name}.{field}" for field in parameters_of(type(shape)))
            for shape in self.singles
        )

    @cached_property
    def sources(self) -> tuple[Source, ...]:
        """Where the spheres come from that a tree finds."""
        return sources_of(self.shapes, self.clouds)

    @cached_property
    def singles(self) -> tuple[Shape, ...]:
        """The shapes that are code of their own in kernels."""
        found = {source.name for source in self.sources}
        return tuple(x for x in self.shapes if f"{x.group}.{x.name}" not in found)

    def number_of(self, name: str) -> int | None:
        """The number in kernels of a shape of this name; None for a cloud, and for none."""
        for number, shape in enumerate(self.singles):
            if name == f"{shape.group}.{shape.name}":
                return number
        for source in self.sources:
            if name == source.name and not source.is_cloud:
                return FIRST + source.first
        return None

    def owner_of(self, number: int) -> tuple[str, int | None]:
        """The name of the shape of a number in kernels; of a cloud, with the place in it."""
        if number < FIRST:
            shape = self.singles[number]
            return f"{shape.group}.{shape.name}", None
        place = number - FIRST
        source = next(own for own in self.sources if place < own.rows.stop)
        return source.name, place - source.first if source.is_cloud else None

    @cached_property
    def tree(self) -> Many:
        """The numbers of the spheres that a tree finds, and the tree."""
        return many_of(self, self.__dict__.get("tree_before"))

    @cached_property
    def marked(self) -> tuple[PlacesOfMany, np.ndarray]:
        """Facts about where these spheres are; see `places_of_many`."""
        lights = [self.numbers.get(f"lights.{light.name}.position") for light in self.lights]
        eye = self.numbers["camera.position"]
        return places_of_many(self.tree.spheres, eye, lights, self.precision)

    @cached_property
    def numbers(self) -> dict[str, Numbers]:
        """The numbers of all parameters."""
        arrays = {name: where.read(self) for name, where in self.locations.items()}
        return numbers_of(arrays, self.locations)

    @cached_property
    def features(self) -> Features:
        """What the scene's kernels have compiled in."""
        if self.fixed is not None:
            return self.fixed
        if "before" not in self.__dict__:
            return features_of(self)
        structure, changed = self.__dict__["before"]
        return features_of(self, structure.features, changed)

    @cached_property
    def structure(self) -> Structure:
        """All of the scene that its kernels are compiled for."""
        structure, _ = self.__dict__.get("before", (None, ()))
        return structure if structure and structure.features == self.features else Structure(self)

    def inputs(self) -> Parameters:
        """All parameters, by their names in kernels, and the direction up."""
        arrays = self._with_gradients()
        copies = {name: type(array)(array) for name, array in arrays.items()}
        copies[UP] = from_numbers([[x] for x in self.camera.up], self.precision)
        return self._of_many() | copies

    def differentiated(self) -> Parameters:
        """Those of `inputs` that have gradients."""
        arrays = self._with_gradients().items()
        return {name: type(array)(array) for name, array in arrays if dr.grad_enabled(array)}

    def _with_gradients(self) -> Parameters:
        """Those of `inputs` that may have gradients."""
        names = self.structure.names.items()
        arrays = {own: self.locations[name].read(self) for name, own in names}
        if self.sources:
            arrays[SPHERES] = attached_spheres(self, self.tree.arrays[SPHERES])
        return arrays

    @property
    def given(self) -> Apart:
        """What kernels are given: `inputs`, without gradients."""
        if not is_recording():
            return self._packed
        inputs = dr.detach(self.inputs())
        # Opaque: each literal value would be compiled into a kernel of its own
        dr.make_opaque(inputs)
        return Apart(inputs)

    @cached_property
    def _packed(self) -> Apart:
        """`given` where the numbers are known."""
        numbers = [self.numbers[name] for name in self.structure.names]
        numbers.append(self.camera.up)
        return packed(self.structure.layout, numbers, self.precision, self._of_many())

    def _of_many(self) -> Parameters:
        """What kernels take of the spheres that a tree finds, without gradients."""
        return self.tree.arrays | {SPECIAL: to_lanes(self.marked[1])} if self.sources else {}

    @property
    def precision(self) -> Precision:
        return precision_of(self.background)

    @cached_property
    def used(self) -> tuple[Material, ...]:
        """The materials of the shapes that rays can meet."""
        names = {name for primitives in self.sets for name in primitives.made_from}
        names |= {source.material for source in self.sources}
        return tuple(material for material in self.materials if material.name in names)

    @cached_property
    def sets(self) -> tuple[Any, ...]:
        """The primitives that rays can meet, by kind of shape."""
        many = () if self.many is None else (self.many,)
        return *sets_of(self.singles, self.features.places), *many

    @property
    def gathered(self) -> Gathered | None:
        """In a kernel: where derivatives by these spheres are taken; None where none are."""
        return None if self.many is None else self.many.gathered

    def gathering(self: Own, gathered: Gathered) -> Own:
        """In a kernel: the scene with derivatives by the spheres that a tree finds."""
        return self._with(many=replace(self.many, gathered=gathered))  # type: ignore[type-var]


FIELDS = tuple(field.name for field in fields(Contents))


def _unpickled(structure: Any, numbers: list[Any], precision: str) -> Contents:
    """The scene of `Scene.__reduce__`."""
    types = precision_named(precision)
    scene: Contents = put_together(structure, (from_numbers(own, types) for own in numbers))
    # Read the numbers now: within a function that the user freezes they cannot be read
    _ = scene.numbers
    return scene
