"""The tables of a scene file: which keys they have, and what each key takes.

They are made from what things say of themselves: their parameters and settings
(`core/parameter.py`).
"""

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Tag, create_model

from ..core.parameter import (
    ANY,
    REQUIRED,
    UNIT,
    Parameter,
    Range,
    parameters_of,
    settings_of,
)
from ..lights import LIGHTS
from ..shapes import SHAPES
from .camera import Camera
from .cloud import Cloud
from .material import Material
from .rows import rows_of
from .surroundings import Surroundings
from .texture import Checkerboard

# Most nodes on a chain of rays: the local memory of a kernel's stack grows with them
MAX_DEPTH = 256
# Most shapes and lights that are no spheres: each is code of its own, and a kernel of 1000 compiles
# for half a minute
MAX_OBJECTS = 1000

# What has a name and a material
GROUPS: dict[str, Any] = {kind.group: kind for kind in SHAPES} | {Cloud.group: Cloud}
# The type of a light's table without one
POINT = next(iter(LIGHTS))


def _check(
    expected: str | Callable[[Any], str],
    accepts: Callable[[Any], bool],
    convert: Callable[[Any], Any],
) -> BeforeValidator:
    """A check of a key's value, with what a message says was expected, which may depend on it."""

    def check(value: Any) -> Any:
        if not accepts(value):
            raise ValueError(
                f"expected {expected if isinstance(expected, str) else expected(value)}"
            )
        return convert(value)

    return BeforeValidator(check)


def _numbers(size: int, legal: Range) -> Any:
    """The type of one number, or of a vector of them, in a range."""

    def is_real(value: Any) -> bool:
        return isinstance(value, (int, float)) and not isinstance(value, bool)

    def is_number(value: Any) -> bool:
        return is_real(value) and legal.holds(value)

    def is_vector(value: Any) -> bool:
        return isinstance(value, list) and len(value) == size and all(map(is_number, value))

    def expected(value: Any) -> str:
        parts = value if isinstance(value, list) else [value]
        real = len(parts) == size and all(map(is_real, parts))
        return legal.expected(size, parts if real else ())

    if size == 1:
        return Annotated[float, _check(expected, is_number, float)]
    return Annotated[
        list[float], _check(expected, is_vector, lambda value: [float(x) for x in value])
    ]


def _is_whole(value: Any, low: int, high: int) -> bool:
    return type(value) is int and low <= value <= high


def _is_resolution(value: Any) -> bool:
    return (
        isinstance(value, list) and len(value) == 2 and all(_is_whole(n, 1, 1 << 20) for n in value)
    )


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and bool(value) and value.isprintable()


Vector = _numbers(3, ANY)
Name = Annotated[str, _check("a name, a string that is not empty", _is_name, str)]
Depth = Annotated[
    int, _check(f"a whole number from 1 to {MAX_DEPTH}", lambda n: _is_whole(n, 1, MAX_DEPTH), int)
]
Resolution = Annotated[
    tuple[int, int],
    _check("[width, height], two whole numbers of pixels > 0", _is_resolution, tuple),
]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid")


def _table(kind: Any, **more: Any) -> type[BaseModel]:
    """The table of a kind of thing: its parameters, its settings, and more keys."""
    keys: dict[str, Any] = {}
    for name, entry in parameters_of(kind).items():
        keys[name] = _numbers(entry.size, entry.legal), _default(entry)
    for name, own in settings_of(kind).items():
        keys[name] = own.kind, ... if own.default is REQUIRED else own.default
    return create_model(f"{kind.__name__}Table", __base__=_Table, **keys, **more)


def _default(entry: Parameter) -> Any:
    """The default of a parameter's key, as pydantic takes it."""
    if entry.default is REQUIRED:
        return ...
    return entry.default if entry.size == 1 else [entry.default] * entry.size


OPTIONAL_NAME = (Name | None, None)
MaterialName = Annotated[str, _check("the name of a material", _is_name, str)]
MaterialOrName = Annotated[str, _check("a Material, or the name of one", _is_name, str)]
CameraTable = _table(Camera, up=(Vector, [0, 1, 0]), resolution=(Resolution, ...))
CheckerTable = _table(Checkerboard)
MaterialTable = _table(Material, checker=(CheckerTable | None, None))
# Of a material by itself. In a file the name is the key of the table
NamedMaterialTable = _table(Material, name=(Name, ...), checker=(CheckerTable | None, None))


def _shape_tables(material: Any) -> dict[str, Any]:
    """The tables of what has a name and a material."""
    more: Any = {"name": OPTIONAL_NAME, "material": (material, ...)}
    spheres: Any = Annotated[Any, BeforeValidator(rows_of)], ...
    tables: dict[str, Any] = {kind.group: _table(kind, **more) for kind in SHAPES}
    cloud = create_model("CloudTable", __base__=_Table, spheres=spheres, **more)
    return tables | {Cloud.group: cloud}


SHAPE_TABLES: dict[str, type[BaseModel]] = _shape_tables(MaterialName)
# Of things by themselves, as Python makes them
SHAPES_IN_PYTHON = _shape_tables(MaterialOrName)
LIGHT_TABLES = {
    name: _table(kind, name=OPTIONAL_NAME, type=(Literal[name], name))
    for name, kind in LIGHTS.items()
}


def light_type(table: Any) -> str:
    """The type that a light's table names; not the name of any where that is not a string."""
    name = table.get("type", POINT) if isinstance(table, dict) else POINT
    return name if isinstance(name, str) else ""


def _any_light() -> Any:
    """A light's table, which its `type` tells."""
    tables = tuple(Annotated[table, Tag(name)] for name, table in LIGHT_TABLES.items())
    union: Any = tables[0]
    for other in tables[1:]:
        union = union | other
    return Annotated[union, Discriminator(light_type)]


SceneTable = _table(
    Surroundings,
    max_depth=(Depth, 5),
    min_importance=(_numbers(1, UNIT), 0),
    camera=(CameraTable, ...),
    materials=(dict[Name, MaterialTable], {}),  # type: ignore[valid-type]
    lights=(list[_any_light()], []),  # type: ignore[misc]
    **{group: (list[table], []) for group, table in SHAPE_TABLES.items()},  # type: ignore[valid-type]
)


# One vector by itself
VectorTable: Any = create_model("VectorTable", __base__=_Table, value=(Vector, ...))
