"""The scene: what there is, and its parameters by name."""

import functools
import inspect
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, ParamSpec

import drjit as dr

from ..core.arrays import Array, precision_named
from ..core.frozen import is_recording
from ..core.host import in_own_memory
from ..core.parameter import Numbers
from ..files.atomic import write_text
from ..mitsuba.writing import write
from . import things
from .assemble import added, assembled, check_in_use, removed, replaced, settings_in, things_in
from .build import checked, fields_of
from .camera import view_problem
from .cloud_files import filed
from .contents import FIELDS, Contents
from .dictionary import dictionary_of, with_rows, with_single_spheres, without_default_names
from .editing import edited_text
from .parameters import (
    as_parameter,
    check_names,
    check_numbers,
    chosen_names,
    numbers_of,
    remedy_of,
)
from .plain import plain
from .schema import SceneError, nearest_or_all
from .summary import summary
from .tables import MAX_DEPTH, MAX_OBJECTS
from .toml import MARK, tables_in, text_of

__all__ = ["MAX_DEPTH", "MAX_OBJECTS", "Scene", "checked_scene"]

Arguments = ParamSpec("Arguments")


def _or_of_fields(constructor: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """A constructor that also takes all fields, from which Dr.Jit and `dataclasses.replace` make
    copies. It refuses other arguments as a file does.
    """
    known = [name for name in inspect.signature(constructor).parameters if name != "self"]

    @functools.wraps(constructor)
    def init(scene: "Scene", *args: Any, **given: Any) -> None:
        if given.keys() == set(FIELDS):
            scene.__dict__.update(given)
            return
        found = [
            f"{key}: unknown key{nearest_or_all(key, known)}" for key in given if key not in known
        ]
        if not args and "camera" not in given:
            found.append("camera: missing; expected a Camera")
        if found:
            raise SceneError("\n".join(found))
        constructor(scene, *args, **given)  # type: ignore[arg-type]

    return init  # type: ignore[return-value]


@dataclass(frozen=True, eq=False, init=False, repr=False)
class Scene(Contents):
    """A scene. It does not change: `replace`, `add` and `remove` make a new one."""

    # What notebooks show. The room of rendering sets it, as there are no rays here
    _repr_png_: ClassVar[Callable[["Scene"], bytes]]

    @_or_of_fields
    def __init__(
        self,
        camera: things.Camera,
        *,
        spheres: Iterable[things.Sphere] = (),
        planes: Iterable[things.Plane] = (),
        discs: Iterable[things.Disc] = (),
        clouds: Iterable[things.Cloud] = (),
        lights: Iterable[things.PointLight | things.DirectionalLight] = (),
        materials: Iterable[things.Material] | Mapping[str, Any] = (),
        background: Any = (0, 0, 0),
        ambient: Any = (0, 0, 0),
        max_depth: int = 5,
        min_importance: float = 0,
        precision: str = "single",
    ) -> None:
        """Make a scene.

        Args:
            camera: a `Camera`.
            spheres, planes, discs: of each kind of shape; of what coincides the first is seen.
            clouds: of many spheres each.
            lights: of all kinds.
            materials: those that shapes name; what a shape is given itself is known anyway.
            background: radiance of a ray that leaves the scene, linear RGB.
            ambient: ambient radiance, linear RGB, which multiplies the albedo.
            max_depth: nodes on the longest chain of rays, from 1 to 256; 1 is the primary hit.
            min_importance: rays whose product of weights is below it are not traced, in [0, 1].
            precision: "single" (float32) or "double" (float64), of every computation.

        Raises:
            SceneError: what a file may not have; the message has a line for each problem.
            ValueError: another precision.
        """
        tables = assembled(
            camera,
            {
                "spheres": spheres,
                "planes": planes,
                "discs": discs,
                "clouds": clouds,
                "lights": lights,
            },
            materials,
            background=background,
            ambient=ambient,
            max_depth=max_depth,
            min_importance=min_importance,
        )
        self.__dict__.update(vars(Scene._read(tables, precision)))

    @classmethod
    def from_dict(cls, tables: Mapping[str, Any], precision: str = "single") -> "Scene":
        """Make a scene of the tables of a scene file.

        Args:
            tables: as `to_dict` gives them, with numbers of Python, NumPy or Dr.Jit.
            precision: "single" (float32) or "double" (float64).

        Raises:
            SceneError: not a valid scene; the message has a line for each problem.
            ValueError: another precision.
        """
        return cls._read(plain(tables), precision)

    @classmethod
    def _read(
        cls,
        tables: Any,
        precision: str,
        *,
        prefix: str = "",
        named: bool = False,
        text: str = "",
        folder: str = "",
    ) -> "Scene":
        """The scene of some tables; see `checked`, and the fields `text` and `folder`."""
        types = precision_named(precision)
        fields = fields_of(checked(tables, prefix, named, folder), types)
        scene = object.__new__(cls)
        scene.__dict__.update(fields, touched=frozenset(), fixed=None, text=text, folder=folder)
        # Read the numbers now: within a function that the user freezes they cannot be read
        _ = scene.numbers
        return scene

    def parameters(self, *names: str) -> dict[str, Array]:
        """Copies of the parameters of these names, or of all.

        Args:
            names: such as "spheres.ball.center"; `*` stands for any part of a name.

        Returns:
            Name to a Dr.Jit array: a `Float`, or an `Array3f` for a vector. In double precision
            these are a `Float64` and an `Array3f64`. Their width is 1; for a cloud it is the number
            of its spheres.

        Raises:
            KeyError: a name that the scene does not have, or a pattern that none matches; the
                message lists the nearest ones.
            TypeError: a list of names, say.
        """
        known = self.locations
        values = {name: known[name].read(self) for name in chosen_names(names, known)}
        return {name: type(value)(value) for name, value in values.items()}

    def replace(self, values: Mapping[str, Any]) -> "Scene":
        """A new scene with these parameters, differentiable in what was replaced.

        Args:
            values: parameter name to a Dr.Jit array like that of `parameters`, or to a number or
                three of them; a dictionary or a `drjit.opt` optimiser. Gradients are tracked
                through the arrays as they are given. Also what has no derivative:
                "spheres.ball.material",
                "camera.resolution", "camera.up", "max_depth", "min_importance",
                "materials.glass.fresnel", "materials.white.checker" (a `Checkerboard`, or None),
                "lights.key.falloff". And things as a whole: "camera" (a `Camera`), "spheres.ball"
                (a `Sphere`), "materials.glass" and so on.

        Raises:
            KeyError: a name that the scene does not have; the message lists the nearest ones. A
                pattern; the message says how to name all that it stands for.
            ValueError: a value that is not one scalar, or not one vector, as its parameter is; or a
                number that has no meaning, as in a file. Steps of optimisers and of differences may
                overstep a closed range, such as [0, 1], by 0.01.
            SceneError: another value that a file may not have.
            TypeError: no dictionary.
        """
        if not hasattr(values, "keys"):
            raise TypeError(
                "replace: expected a dictionary, as in {'spheres.ball.radius': 0.4}, "
                f"got a {type(values).__name__}"
            )
        known = self.locations
        if not all(name in known for name in values.keys()):  # noqa: SIM118 (an optimiser's are)
            return self._with_settings(values)
        arrays = {
            name: as_parameter(name, value, known[name].read(self), known[name].entry.many)
            for name, value in values.items()
        }
        self._check_recording(arrays)
        # While a kernel is recorded numbers are not known; those of before decide what is compiled
        numbers = {} if is_recording() else numbers_of(arrays, known)
        remedy = remedy_of(values)
        check_numbers(numbers, known, remedy)
        self._check_view(numbers, remedy)
        # An array that was given may stand in NumPy's memory
        arrays |= {name: in_own_memory(arrays[name]) for name in numbers}
        new = self.neutral.keys() & arrays.keys()
        scene = self._with(touched=self.touched | new, **self._changes(arrays))
        scene.__dict__.update(
            numbers=self.numbers | numbers, before=(self.structure, arrays.keys())
        )
        if self.sources:
            scene.__dict__["tree_before"] = self.tree
        return scene

    def _with_settings(self, values: Mapping[str, Any]) -> "Scene":
        """The same where some names are not those of parameters."""
        tables = dictionary_of(self)
        settings = things_in(tables) | settings_in(tables)
        check_names(values.keys(), {**self.locations, **settings})
        changed = {name: values[name] for name in values.keys() if name in settings}  # noqa: SIM118
        scene = self._edited(replaced(tables, changed, self.precision), changed)
        rest = {name: values[name] for name in values.keys() if name not in changed}  # noqa: SIM118
        return scene.replace(rest) if rest else scene

    def add(self, *new: things.Thing) -> "Scene":
        """A new scene with more shapes, lights or materials.

        Args:
            new: `Sphere`, `PointLight`, `Material` and so on; the materials that shapes are given
                themselves are added, too.

        Raises:
            SceneError: a name that is taken, or a material that the scene does not have.
            TypeError: something else.
        """
        return self._edited(added(dictionary_of(self), new, self.precision))

    def remove(self, *names: str) -> "Scene":
        """A new scene without some things.

        Args:
            names: such as "ball", or "spheres.ball" where other things have the same name.

        Raises:
            KeyError: nothing has this name, or several things; the message lists names.
            SceneError: a material that shapes still have.
        """
        tables = dictionary_of(self)
        for name in names:
            tables = removed(tables, name)
        check_in_use(tables, [material.name for material in self.materials])
        return self._edited(tables)

    def _edited(self, tables: dict[str, Any], changed: Iterable[str] = ()) -> "Scene":
        """The scene of other tables; parameters that it still has keep their arrays.

        Args:
            changed: names of keys whose tables are new.
        """
        about = {"text": self.text, "folder": self.folder}
        scene = Scene._read(tables, self.precision.name, named=True, **about)
        # All spheres of a cloud are new together
        new = tuple(f"{name.removesuffix('.spheres')}." for name in changed)
        kept = {
            name: where.read(self)
            for name, where in self.locations.items()
            if name in scene.locations and not name.startswith(new)
        }
        touched = self.touched & scene.neutral.keys()
        scene = scene._with(touched=touched, **scene._changes(kept))
        _ = scene.numbers
        return scene

    def astype(self, precision: str) -> "Scene":
        """The scene in another precision, differentiable in what this one is.

        Args:
            precision: "single" (float32) or "double" (float64).

        Raises:
            ValueError: another precision.
        """
        types = precision_named(precision)
        arrays = {name: where.read(self) for name, where in self.locations.items()}
        scene = self._with(
            **self._changes(
                {
                    name: (types.vector if dr.depth_v(array) == 2 else types.real)(array)
                    for name, array in arrays.items()
                }
            )
        )
        _ = scene.numbers
        return scene

    def to_dict(self) -> dict[str, Any]:
        """The tables of a scene file: what has its default is left out.

        Numbers are the shortest decimals that give those of the scene. What an optimiser has moved
        over a closed end of its range is that end.
        """
        return without_default_names(with_rows(dictionary_of(self)))

    def save(self, path: str | Path) -> None:
        """Write a scene file.

        What the file that the scene was read from still says stays as it is written there, with
        its comments. What is removed takes the comment directly above it along. Only a file of
        inline or dotted tables may have to be written anew, without comments.

        Args:
            path: a TOML file; an old one is replaced only if all goes well.

        Raises:
            OSError: the file cannot be written.
        """
        path = Path(path)
        scene = self._with(clouds=filed(self, path))
        write_text(path, scene._edited_text(path.parent) or text_of(scene))

    def _edited_text(self, folder: Path) -> str:
        """The text of the file that the scene was read from, with what has changed; empty without
        one, and where it is written in a way that cannot be edited.

        Args:
            folder: where the new file will be.
        """
        if not self.text:
            return ""
        precision = self.precision.name
        try:
            before = Scene._read(tables_in(self.text), precision, folder=self.folder)
            text = edited_text(self.text.removeprefix(MARK), before, self)
            after = Scene._read(tables_in(text), precision, folder=str(folder))
        except (LookupError, ValueError):
            # Some ways to write a file tomlkit does not edit
            return ""
        return text if dictionary_of(after) == dictionary_of(self) else ""

    def to_mitsuba(self, *, approximate: bool = False) -> dict[str, Any]:
        """The scene for Mitsuba 3, as a dictionary that `mitsuba.load_dict` takes.

        Mitsuba is not needed for it. `whitted.mitsuba` has the table of what is what. Materials
        that no shape has are left out.

        Args:
            approximate: whether to write what has no exact counterpart there, with a warning for
                each.

        Raises:
            SceneError: something has no counterpart in Mitsuba; the message has a line for each
                problem, with its path.
        """
        written, report = write(with_single_spheres(dictionary_of(self, whole=True)), approximate)
        if report.problems:
            raise SceneError("\n".join(report.problems))
        for warning in report.warnings:
            warnings.warn(warning, stacklevel=2)
        return written

    def __repr__(self) -> str:
        return summary(self)

    def _check_recording(self, names: Iterable[str]) -> None:
        """Refuse to move the spheres of a tree while a kernel is recorded."""
        own = tuple(f"{source.name}." for source in self.sources)
        moved = [name for name in names if name.startswith(own)] if own else []
        if moved and is_recording():
            remedy = "replace them outside, and give the function the scene"
            raise ValueError(
                f"{moved[0]}: a tree of spheres cannot be built in a frozen function; {remedy}"
            )

    def _check_view(self, changed: Mapping[str, Numbers], remedy: str) -> None:
        """Refuse a camera that looks nowhere."""
        names = "camera.position", "camera.look_at"
        if changed.keys().isdisjoint(names):
            return
        position, look_at = (changed.get(name, self.numbers[name]) for name in names)
        if (wrong := view_problem(position, look_at, self.camera.up)) is not None:
            field, expected = wrong
            value = {"look_at": look_at, "up": self.camera.up}[field]
            told = ", ".join(f"{x:g}" for x in value)
            raise ValueError(f"camera.{field} = {told}: {expected}{remedy}")


def checked_scene(value: object, where: str = "scene") -> Scene:
    """A value that has to be a scene.

    Args:
        where: what the message begins with.

    Raises:
        TypeError: the message says how to load one.
    """
    if not isinstance(value, Scene):
        loaded = isinstance(value, (str, Path))
        given = repr(str(value)) if loaded else "'cornell'"
        got = given if loaded else f"a {type(value).__name__}"
        raise TypeError(
            f"{where}: expected a Scene, got {got}; load one with whitted.load_scene({given})"
        )
    return value
