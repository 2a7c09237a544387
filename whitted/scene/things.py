"""What scenes are made of in Python: a description of each kind of thing, checked as in a file.

Each constructor is written out, so that completion and type checkers see it. `_checked` takes its
arguments for the keys of a table, so that a body has nothing left to do.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, ParamSpec

import drjit as dr
import numpy as np

from ..core.parameter import parameters_of
from ..lights import directional, point
from ..shapes import disc, plane, sphere
from . import camera, cloud, material, texture
from .dictionary import TYPES
from .plain import plain
from .rows import Rows, rows_of
from .schema import SceneError, nearest_or_all, thing_problems
from .tables import LIGHT_TABLES, SHAPES_IN_PYTHON, CameraTable, CheckerTable, NamedMaterialTable

Arguments = ParamSpec("Arguments")
# A number, or three of them: Python's, NumPy's or Dr.Jit's
Number = Any
Vector = Any


def _checked(constructor: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """A constructor that checks its arguments as the keys of a file, and stores them."""

    @functools.wraps(constructor)
    def init(thing: "Thing", *names: Any, **given: Any) -> None:
        if len(names) > thing.named or (names and "name" in given):
            rest = "all arguments but the name" if thing.named else "all arguments"
            raise TypeError(f"{type(thing).__name__}: {rest} are given by keyword")
        thing._fill({"name": names[0], **given} if names else given)

    return init  # type: ignore[return-value]


class Thing:
    """A description of a thing. It does not change; its attributes are its arguments."""

    # What is described, and the first part of its path in messages
    kind: ClassVar[Any]
    group: ClassVar[str]
    named: ClassVar[bool] = True

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    @classmethod
    def model(cls) -> Any:
        """The model of its table in a file."""
        return LIGHT_TABLES[TYPES[cls.kind]] if cls.kind in TYPES else SHAPES_IN_PYTHON[cls.group]

    @classmethod
    def settings(cls) -> list[str]:
        """The arguments that are no parameters, but for the name."""
        parameters = parameters_of(cls.kind)
        return [key for key in cls.model().model_fields if key not in {*parameters, "name", "type"}]

    def table(self) -> dict[str, Any]:
        """Its table in a file."""
        return {key: in_a_table(own) for key, own in vars(self).items() if own is not None}

    def _fill(self, given: Mapping[str, Any]) -> None:
        model = self.model()
        fields = {key: field for key, field in model.model_fields.items() if key != "type"}
        # None stands for no name, and for no checkerboard
        given = {
            key: own
            for key, own in given.items()
            if not (own is None and key in fields and fields[key].default is None)
        }
        raw = plain({key: in_a_table(own) for key, own in given.items()})
        found = thing_problems(model, self.kind, raw, self._where(raw.get("name")))
        if "type" in raw:
            known = nearest_or_all("type", fields)
            found.append(f"{self._where(raw.get('name'))}.type: unknown key{known}")
        if found:
            raise SceneError("\n".join(found))
        values = model.model_validate(raw)
        for key in fields:
            own = getattr(values, key)
            if isinstance(own, CheckerTable):
                own = Checkerboard(**dict(own))
            self.__dict__[key] = tuple(own) if isinstance(own, list) else own
        if isinstance(given.get("material"), Material):
            self.__dict__["material"] = given["material"]

    def _where(self, name: object) -> str:
        """The path to the thing."""
        if not self.named:
            return self.group
        known = isinstance(name, str) and name and name.isprintable()
        return f"{self.group}.{name}" if known else self.group[:-1]

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{name}: a {type(self).__name__} does not change; make a new one")

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and vars(self) == vars(other)

    def __hash__(self) -> int:
        return hash((type(self), *vars(self).values()))

    def __repr__(self) -> str:
        fields = self.model().model_fields
        given = [
            f"{key}={own.name if isinstance(own, Material) else own!r}"
            for key, own in vars(self).items()
            if key != "name" and plain(own) != fields[key].default
        ]
        name = [repr(self.name)] if self.named and self.name is not None else []
        return f"{type(self).__name__}({', '.join(name + given)})"


def in_a_table(value: Any) -> Any:
    """An argument as the value of a key."""
    if isinstance(value, Material):
        return value.name
    if isinstance(value, Checkerboard):
        return value.table()
    return list(value) if isinstance(value, tuple) else value


class Checkerboard(Thing):
    """A board on the flat shapes of a material."""

    kind, group, named = texture.Checkerboard, "checker", False

    @classmethod
    def model(cls) -> Any:
        return CheckerTable

    @_checked
    def __init__(self, *, color: Vector, size: Number) -> None:
        """Describe a checkerboard.

        Args:
            color: of every other cell, linear RGB in [0, 1]; the others have the material's.
            size: the side of a cell, > 0.

        Raises:
            SceneError: a value that a file may not have.
        """


class Material(Thing):
    """How a surface shades, reflects and refracts."""

    kind, group = material.Material, "materials"

    @classmethod
    def model(cls) -> Any:
        return NamedMaterialTable

    @_checked
    def __init__(
        self,
        name: str,
        *,
        color: Vector = (0, 0, 0),
        specular: Number = 0,
        shininess: Number = 50,
        reflection: Number = 0,
        refraction: Number = 0,
        ior: Number = 1.5,
        shadow: Number = 1,
        fresnel: bool = False,
        checker: Checkerboard | Mapping[str, Any] | None = None,
    ) -> None:
        """Describe a material.

        Args:
            color: Lambertian albedo, linear RGB in [0, 1].
            specular: Blinn-Phong coefficient, >= 0.
            shininess: Blinn-Phong exponent, > 0.
            reflection, refraction: weights of the mirrored and of the refracted ray, in [0, 1].
            ior: index of refraction, > 0.
            shadow: the part of a light that it keeps away from what lies behind it, in [0, 1].
            fresnel: whether the weights are scaled by the Fresnel equations.
            checker: a second colour in cells; only flat shapes can show it.

        Raises:
            SceneError: a value that a file may not have.
        """


class Sphere(Thing):
    """A sphere."""

    kind, group = sphere.Sphere, "spheres"

    @_checked
    def __init__(
        self, name: str | None = None, *, center: Vector, radius: Number, material: Material | str
    ) -> None:
        """Describe a sphere.

        Args:
            name: unique among spheres; without one it is "sphere0", "sphere1" and so on.
            center: a point.
            radius: > 0.
            material: itself, or its name.

        Raises:
            SceneError: a value that a file may not have.
        """


class Plane(Thing):
    """An infinite plane: the points p with normal . p + offset = 0."""

    kind, group = plane.Plane, "planes"

    @_checked
    def __init__(
        self, name: str | None = None, *, normal: Vector, offset: Number, material: Material | str
    ) -> None:
        """Describe a plane.

        Args:
            name: unique among planes; without one it is "plane0", "plane1" and so on.
            normal: a direction of any length. It counts as a unit vector.
            offset: the distance from the origin to the plane, against the normal.
            material: itself, or its name.

        Raises:
            SceneError: a value that a file may not have.
        """


class Disc(Thing):
    """A flat disc."""

    kind, group = disc.Disc, "discs"

    @_checked
    def __init__(
        self,
        name: str | None = None,
        *,
        center: Vector,
        normal: Vector,
        radius: Number,
        material: Material | str,
    ) -> None:
        """Describe a disc.

        Args:
            name: unique among discs; without one it is "disc0", "disc1" and so on.
            center: a point.
            normal: a direction of any length.
            radius: > 0.
            material: itself, or its name.

        Raises:
            SceneError: a value that a file may not have.
        """


class Cloud(Thing):
    """Many spheres of one material."""

    kind, group = cloud.Cloud, "clouds"

    def __init__(
        self,
        name: str | None = None,
        *,
        center: Any = None,
        radius: Any = None,
        spheres: Any = None,
        material: Material | str,
    ) -> None:
        """Describe a cloud.

        Args:
            name: unique among clouds; without one it is "cloud0", "cloud1" and so on.
            center: points, of shape (N, 3).
            radius: numbers > 0, of shape (N,), or one for all.
            spheres: both side by side, of shape (N, 4), in place of center and radius.
            material: itself, or its name.

        Raises:
            SceneError: a value that a file may not have, or arrays that do not fit each other.

        Example:
            >>> beads = whitted.Cloud(center=numpy.random.rand(500, 3), radius=0.02, material=glass)
        """
        given = {} if name is None else {"name": name}
        if spheres is None:
            spheres = self._joined(name, center, radius)
        elif center is not None or radius is not None:
            raise SceneError(f"{self._where(name)}: give spheres, or center and radius, not all")
        try:
            rows = rows_of(spheres if isinstance(spheres, (list, Rows)) else _array_of(spheres))
        except ValueError as error:
            raise SceneError(f"{self._where(name)}.spheres: {error}") from None
        self._fill({**given, "spheres": rows, "material": material})

    @property
    def center(self) -> np.ndarray:
        """The centers, of shape (N, 3)."""
        center: np.ndarray = self.spheres.numbers[:, :3]
        return center

    @property
    def radius(self) -> np.ndarray:
        """The radii, of shape (N,)."""
        radius: np.ndarray = self.spheres.numbers[:, 3]
        return radius

    def _joined(self, name: object, center: Any, radius: Any) -> np.ndarray:
        """Centers and radii side by side."""
        center, radius = _array_of(center), _array_of(radius)
        center = center.reshape(-1, 3) if center.shape == (0,) else center
        where = self._where(name)
        if center.dtype.kind not in "fiu" or center.ndim != 2 or center.shape[1] != 3:
            raise SceneError(
                f"{where}.center: expected numbers of shape (N, 3), got {_told(center)}"
            )
        if radius.dtype.kind not in "fiu" or radius.shape not in ((), (1,), center.shape[:1]):
            expected = f"{len(center)} numbers > 0, or one for all"
            raise SceneError(f"{where}.radius: expected {expected}, got {_told(radius)}")
        return np.column_stack([center, np.broadcast_to(radius, len(center))])

    def __hash__(self) -> int:
        return hash((type(self), self.name))


def _array_of(value: Any) -> np.ndarray:
    """The numbers of an array of any kind."""
    if value is not None and dr.is_array_v(value):
        own: np.ndarray = dr.detach(value).numpy()
        return own.T if dr.depth_v(value) == 2 and not dr.is_tensor_v(value) else own
    try:
        return np.asarray(value)
    except ValueError:
        # Rows of different lengths
        return np.empty(0, object)


def _told(array: np.ndarray) -> str:
    return f"shape {array.shape}" if array.dtype.kind in "fiu" else "something else"


class PointLight(Thing):
    """A light at a point."""

    kind, group = point.PointLight, "lights"

    @_checked
    def __init__(
        self,
        name: str | None = None,
        *,
        position: Vector,
        intensity: Vector,
        falloff: Literal["none", "inverse-square"] = "none",
    ) -> None:
        """Describe a point light.

        Args:
            name: unique among lights; without one it is "light0", "light1" and so on.
            position: a point.
            intensity: linear RGB; radiant intensity in W/sr, or, with the falloff "none", the
                irradiance at any distance.
            falloff: "inverse-square", or "none".

        Raises:
            SceneError: a value that a file may not have.
        """


class DirectionalLight(Thing):
    """Parallel light from infinitely far away, as from the sun."""

    kind, group = directional.DirectionalLight, "lights"

    @_checked
    def __init__(self, name: str | None = None, *, direction: Vector, irradiance: Vector) -> None:
        """Describe a directional light.

        Args:
            name: unique among lights; without one it is "light0", "light1" and so on.
            direction: in which the light travels, of any length.
            irradiance: linear RGB, of a surface that faces the light.

        Raises:
            SceneError: a value that a file may not have.
        """


class Camera(Thing):
    """A pinhole camera."""

    kind, group, named = camera.Camera, "camera", False

    @classmethod
    def model(cls) -> Any:
        return CameraTable

    @_checked
    def __init__(
        self,
        *,
        position: Vector,
        look_at: Vector,
        fov: Number,
        resolution: Sequence[int],
        up: Vector = (0, 1, 0),
    ) -> None:
        """Describe a camera.

        Args:
            position, look_at: the eye, and a point that it looks at.
            fov: vertical field of view in degrees, in (0, 180).
            resolution: width and height in pixels.
            up: a direction that is not parallel to the view.

        Raises:
            SceneError: a value that a file may not have.
        """


SHAPES = (Sphere, Plane, Disc, Cloud)
LIGHTS = (PointLight, DirectionalLight)
