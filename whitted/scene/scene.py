"""The scene: what there is, and its parameters by name."""

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import drjit as dr

from ..core.arrays import PRECISIONS, Array, Precision, precision_of
from ..core.host import from_numbers, in_own_memory, to_numbers
from ..core.parameter import ANY, NON_NEGATIVE, Numbers, parameter, parameters_of
from ..core.pytree import put_together, take_apart
from ..lights import Light
from ..shapes import SHAPES, Shape
from ..shapes.sets import ShapeSet, sets_of
from .camera import Camera, view_problem
from .features import Features, features_of
from .material import Material
from .parameters import (
    Location,
    as_parameter,
    check_names,
    check_numbers,
    locations_in,
    numbers_of,
    with_values,
)
from .structure import Structure

# Most nodes on a chain of rays: the local memory of a kernel's stack grows with them
MAX_DEPTH = 256
# Most shapes and lights: each is code of its own, and a kernel of 1000 compiles for half a minute
MAX_OBJECTS = 1000


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene. It does not change: `replace` makes a new one."""

    camera: Camera
    resolution: tuple[int, int]
    # By kind, in the order of `SHAPES`, then in that of the file
    shapes: tuple[Shape, ...]
    materials: tuple[Material, ...]
    lights: tuple[Light, ...]
    # Radiance of a ray that leaves the scene
    background: Array = parameter(3, ANY, usual=NON_NEGATIVE, default=0)
    # Ambient radiance, which multiplies the albedo
    ambient: Array = parameter(3, ANY, usual=NON_NEGATIVE, default=0, neutral=0)
    max_depth: int = 5
    min_importance: float = 0.0
    # The parameters with a neutral value that `replace` has changed
    touched: frozenset[str] = frozenset()
    # In a kernel: the features that it is compiled for
    fixed: Features | None = None

    def parameters(self, *names: str) -> dict[str, Array]:
        """Copies of the parameters of these names, or of all.

        Returns:
            Name to a Dr.Jit array of width 1: a `Float`, or an `Array3f` for a vector. In double
            precision these are a `Float64` and an `Array3f64`.

        Raises:
            KeyError: a name that the scene does not have; the message lists the nearest ones.
        """
        known = self.locations
        check_names(names, known)
        values = {name: known[name].read(self) for name in names or known}
        return {name: type(value)(value) for name, value in values.items()}

    def replace(self, values: Mapping[str, Array]) -> "Scene":
        """A new scene with these parameters, differentiable in what was replaced.

        Args:
            values: parameter name to a Dr.Jit array of width 1, or to a number or three of them; a
                dictionary or a `drjit.opt` optimiser. Gradients are tracked through the arrays as
                they are given.

        Raises:
            KeyError: a name that the scene does not have; the message lists the nearest ones.
            ValueError: a value that is not one scalar, or not one vector, as its parameter is; or a
                number that has no meaning, as in a file. Steps of optimisers and of differences may
                overstep a closed range, such as [0, 1], by 0.01.
        """
        known = self.locations
        check_names(values.keys(), known)
        arrays = {
            name: as_parameter(name, value, known[name].read(self))
            for name, value in values.items()
        }
        # While a kernel is recorded numbers are not known; those of before decide what is compiled
        numbers = {} if _is_recording() else numbers_of(arrays)
        check_numbers(numbers, known)
        self._check_view(numbers)
        # An array that was given may stand in NumPy's memory
        arrays |= {name: in_own_memory(arrays[name]) for name in numbers}
        new = self.neutral.keys() & arrays.keys()
        scene = self._with(touched=self.touched | new, **self._changes(arrays))
        scene.__dict__.update(
            numbers=self.numbers | numbers, before=(self.structure, arrays.keys())
        )
        return scene

    def _check_view(self, changed: Mapping[str, Numbers]) -> None:
        """Refuse a camera that looks nowhere."""
        names = "camera.position", "camera.look_at"
        if changed.keys().isdisjoint(names):
            return
        position, look_at = (changed.get(name, self.numbers[name]) for name in names)
        if (wrong := view_problem(position, look_at, self.camera.up)) is not None:
            field, expected = wrong
            value = {"look_at": look_at, "up": self.camera.up}[field]
            told = ", ".join(f"{x:g}" for x in value)
            raise ValueError(
                f"camera.{field} = {told}: {expected}; bound the steps of the optimiser"
            )

    def carrying(self, values: Mapping[str, Array]) -> "Scene":
        """The scene with these arrays for its parameters, unchecked and of any width."""
        return self._with(**self._changes(values))

    def _changes(self, values: Mapping[str, Array]) -> dict[str, Any]:
        """The fields of the scene that hold other arrays than now, by the names of parameters."""
        fields: dict[str, dict[int | None, dict[tuple[str, ...], Array]]] = {}
        for name, value in values.items():
            where = self.locations[name]
            fields.setdefault(where.field, {}).setdefault(where.place, {})[where.path] = value
        return {field: self._changed(field, places) for field, places in fields.items()}

    def _changed(self, field: str, places: dict) -> Any:
        old = getattr(self, field)
        if isinstance(old, tuple):
            return tuple(with_values(x, places[k]) if k in places else x for k, x in enumerate(old))
        return places[None][()] if () in places[None] else with_values(old, places[None])

    def _with(self, **changes: Any) -> "Scene":
        """A copy with these fields, which has the same parameters."""
        scene = replace(self, **changes)
        derived = ("locations", "neutral", "names_by_shape")
        scene.__dict__.update({name: getattr(self, name) for name in derived})
        return scene

    def __eq__(self, other: object) -> bool:
        """Whether another scene has the same objects, numbers, settings and precision."""
        if not isinstance(other, Scene):
            return NotImplemented
        return self._described == other._described and self.numbers == other.numbers

    def __hash__(self) -> int:
        return hash(self._described)

    @cached_property
    def _described(self) -> Hashable:
        """All of the scene but its numbers, and whether `replace` has touched them."""
        plain = replace(self, touched=frozenset(), fixed=None)
        return take_apart(plain, []), self.precision.name

    def __reduce__(self) -> tuple[Any, ...]:
        """What is pickled: plain numbers, without gradients.

        Arrays would arrive in NumPy's memory, where kernels are slow.
        """
        arrays: list[Array] = []
        structure = take_apart(self, arrays)
        return _unpickled, (structure, [to_numbers(array) for array in arrays], self.precision.name)

    def __copy__(self) -> "Scene":
        """The scene itself, as it does not change."""
        return self

    def __deepcopy__(self, _: object) -> "Scene":
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
        for field in ("materials", "lights"):
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
        """The names of each shape's parameters."""
        return tuple(
            tuple(f"{shape.group}.{shape.name}.{field}" for field in parameters_of(type(shape)))
            for shape in self.shapes
        )

    @cached_property
    def numbers(self) -> dict[str, Numbers]:
        """The numbers of all parameters."""
        return numbers_of({name: where.read(self) for name, where in self.locations.items()})

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

    @property
    def precision(self) -> Precision:
        return precision_of(self.background)

    @cached_property
    def used(self) -> tuple[Material, ...]:
        """The materials of the shapes that rays can meet."""
        names = {name for primitives in self.sets for name in primitives.made_from}
        return tuple(material for material in self.materials if material.name in names)

    @cached_property
    def sets(self) -> tuple[ShapeSet, ...]:
        """The primitives that rays can meet, by kind of shape."""
        return sets_of(self.shapes, self.features.places)


def _unpickled(structure: Any, numbers: list[Any], precision: str) -> Scene:
    """The scene of `Scene.__reduce__`."""
    (types,) = (each for each in PRECISIONS if each.name == precision)
    scene: Scene = put_together(structure, (from_numbers(own, types) for own in numbers))
    # Read the numbers now: within a function that the user freezes they cannot be read
    _ = scene.numbers
    return scene


def _is_recording() -> bool:
    return dr.flag(dr.JitFlag.SymbolicScope) or dr.flag(dr.JitFlag.FreezingScope)
