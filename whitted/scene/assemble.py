"""The tables of a scene that is made, or changed, in Python."""

import difflib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ..core.arrays import Precision
from .dictionary import TYPES
from .plain import plain
from .schema import SceneError, default_name
from .tables import GROUPS, POINT
from .things import LIGHTS, SHAPES, Camera, Material, Thing, in_a_table

Tables = dict[str, Any]
# What each list of a scene holds
KINDS: dict[str, tuple[type[Thing], ...]] = {kind.group: (kind,) for kind in SHAPES}
KINDS["lights"] = LIGHTS


def assembled(camera: Any, groups: Mapping[str, Any], materials: Any, **more: Any) -> Tables:
    """The tables of a new scene.

    Args:
        camera: a `Camera`, or its table.
        groups: for each group of shapes, and for "lights", things or tables.
        materials: `Material`s, or a dictionary of those or of tables, by name.
        more: the other keys of a file.

    Raises:
        SceneError: something else than a thing of its group, or two materials of one name.
    """
    found: list[str] = []
    tables: Tables = {**more, "camera": _table(camera)}
    if not isinstance(camera, (Camera, Mapping)):
        found.append(f"camera = {camera!r}: expected a Camera")
    listed = _by_name(materials, found)
    for group, things in groups.items():
        things = _list_of(group, things, found)
        tables[group] = [_table(thing) for thing in things]
        for i, thing in enumerate(things):
            if not isinstance(thing, (*KINDS[group], Mapping)):
                found.append(f"{group}[{i}] = {thing!r}: expected a {_kinds(group)}")
            elif isinstance(thing, Thing) and group in GROUPS:
                _enter(listed, thing.material, found)
    _refuse(found)
    return _finished(tables | {"materials": listed})


def _list_of(name: str, things: Any, found: list[str]) -> list[Any]:
    """The things that are given for a list.

    Args:
        found: gets a line if they are something else.
    """
    if isinstance(things, (str, Mapping, Thing)) or not isinstance(things, Iterable):
        found.append(f"{name} = {things!r}: expected a list, each a {_kinds(name)}")
        return []
    return list(things)


def _kinds(group: str) -> str:
    """What a list may hold, in words."""
    return " or a ".join(kind.__name__ for kind in KINDS.get(group, (Material,)))


def added(tables: Tables, things: Iterable[Any], precision: Precision) -> Tables:
    """The tables of a scene with more things.

    Raises:
        SceneError: the name of a material is taken.
        TypeError: what is neither a shape, a light nor a material.
    """
    found: list[str] = []
    result = plain(tables)
    materials = result.setdefault("materials", {})
    for thing in things:
        group = next((key for key, kinds in KINDS.items() if isinstance(thing, kinds)), None)
        if isinstance(thing, Material):
            if thing.name in materials:
                found.append(f"materials.{thing.name}: taken; names are unique")
            materials[thing.name] = _table(thing)
        elif group is None:
            raise TypeError(
                f"add: expected a shape, a light or a material, got a {type(thing).__name__}"
            )
        else:
            if group in GROUPS:
                _enter(materials, thing.material, found, precision)
            own = result.setdefault(group, [])
            own.append(_table(thing) | {"name": thing.name or _free_name(group, own)})
    _refuse(found)
    return _finished(result)


def removed(tables: Tables, name: str) -> Tables:
    """The tables of a scene without one thing.

    Raises:
        KeyError: there is no such thing, or there are several.
    """
    if not isinstance(name, str):
        raise KeyError(f"expected the name of a thing, as in remove('ball'), got {name!r}")
    places = list(_places(tables))
    found = [each for each in places if name in (f"{each[0]}.{each[1]}", each[1])]
    if len(found) != 1:
        paths = [f"{group}.{own}" for group, own, _ in found or places]
        if found:
            raise KeyError(f"'{name}' may be {' or '.join(paths)}; give one of these")
        near = difflib.get_close_matches(name, [path.partition(".")[2] for path in paths], 3, 0.5)
        told = f"nearest: {', '.join(near or paths[:3])}" if paths else "it is empty"
        raise KeyError(f"the scene has nothing called '{name}'; {told}")
    ((group, _, place),) = found
    result: Tables = plain(tables)
    del result[group][place]
    return result


def check_in_use(tables: Tables, materials: Iterable[str]) -> None:
    """Refuse tables that lack a material of a shape.

    Args:
        materials: names that there were.

    Raises:
        SceneError: the message has a line for each material, with the shapes.
    """
    found = []
    for material in set(materials) - tables.get("materials", {}).keys():
        users = [
            f"{group}.{own['name']}"
            for group in GROUPS
            for own in tables.get(group, [])
            if own["material"] == material
        ]
        if users:
            remedy = "remove those as well, or first give them another material"
            found.append(f"materials.{material}: still in use, by {', '.join(users)}; {remedy}")
    _refuse(sorted(found))


def settings_in(tables: Tables) -> dict[str, tuple[Any, ...]]:
    """The settings that `Scene.replace` takes: names, and the path to each in the tables."""
    found: dict[str, tuple[Any, ...]] = {key: (key,) for key in ("max_depth", "min_importance")}
    found |= {f"camera.{key}": ("camera", key) for key in Camera.settings()}
    for group, name, place in _places(tables):
        for key in _kind(group, tables[group][place]).settings():
            found[f"{group}.{name}.{key}"] = group, place, key
    return found


def things_in(tables: Tables) -> dict[str, tuple[Any, ...]]:
    """The things that it takes as a whole: names, and the path to each in the tables."""
    found = {f"{group}.{name}": (group, place) for group, name, place in _places(tables)}
    return found | {"camera": ("camera",)}


def replaced(tables: Tables, values: Mapping[str, Any], precision: Precision) -> Tables:
    """The tables of a scene with other settings and things, by the names of `settings_in` and
    `things_in`.

    Raises:
        SceneError: the name of a material is taken, or something else is given for a thing.
    """
    found: list[str] = []
    settings, result = settings_in(tables), plain(tables)
    known = things_in(tables) | settings
    for name, value in values.items():
        *path, key = known[name]
        if wrong := _wrong_kind(name, value, name in settings):
            found.append(wrong)
            continue
        table = result
        for part in path:
            table = table[part]
        table[key] = plain(in_a_table(value)) if name in settings else _whole(name, value)
        material = value if name in settings else vars(value).get("material")
        _enter(result.setdefault("materials", {}), material, found, precision)
    _refuse(found)
    return _finished(result)


def _wrong_kind(name: str, value: Any, setting: bool) -> str:
    """What is wrong with a value that `Scene.replace` is given; empty if nothing is."""
    group, _, own = name.partition(".")
    if setting:
        wrong = name.endswith(".material") and not isinstance(value, (str, Material))
        return f"{name} = {value!r}: expected a Material, or the name of one" if wrong else ""
    kinds = (Camera,) if group == "camera" else KINDS.get(group, (Material,))
    if not isinstance(value, kinds):
        return f"{name} = {value!r}: expected a {' or a '.join(each.__name__ for each in kinds)}"
    if own and value.name not in (None, own):
        return f"{name}: the new one's own name is {value.name!r}; add it, and remove '{own}'"
    return ""


def _whole(name: str, thing: Thing) -> Any:
    """The table of a thing that takes the place, and the name, of another one."""
    group, _, own = name.partition(".")
    return _table(thing) | ({"name": own} if group in KINDS else {})


def _refuse(found: list[str]) -> None:
    if found:
        raise SceneError("\n".join(found))


def _finished(tables: Tables) -> Tables:
    """Tables of which some materials were given themselves."""
    materials = {name: _table(own) for name, own in tables.get("materials", {}).items()}
    finished: Tables = plain(tables | {"materials": materials})
    return finished


def _table(thing: Any) -> Any:
    """The table of a thing, as its list or its key holds it; a table stays as it is."""
    if not isinstance(thing, Thing):
        return thing
    table = thing.table()
    if isinstance(thing, Material):
        del table["name"]
    elif TYPES.get(thing.kind, POINT) != POINT:
        table["type"] = TYPES[thing.kind]
    return plain(table)


def _by_name(materials: Any, found: list[str]) -> dict[str, Any]:
    """Materials by name."""
    if isinstance(materials, Mapping):
        for name, own in materials.items():
            if isinstance(own, Material) and own.name != name:
                found.append(f"materials.{name}: the material's own name is {own.name!r}")
        return dict(materials)
    listed: dict[str, Any] = {}
    for i, own in enumerate(_list_of("materials", materials, found)):
        if isinstance(own, Material):
            _enter(listed, own, found)
        else:
            found.append(f"materials[{i}] = {own!r}: expected a Material")
    return listed


def _enter(
    materials: dict[str, Any], own: Any, found: list[str], precision: Precision | None = None
) -> None:
    """List a material that is given itself.

    Args:
        found: gets a line if it differs from another one of this name.
        precision: of the numbers of those that are listed.
    """
    if not isinstance(own, Material):
        return
    known = materials.setdefault(own.name, own)
    if known is own:
        return
    if not isinstance(known, Material):
        known = Material(own.name, **known)
    if _rounded(known, precision) != _rounded(own, precision):
        found.append(f"materials.{own.name}: two different materials have this name")


def _rounded(thing: Thing, precision: Precision | None) -> Any:
    """The table of a thing with the numbers that a precision has."""

    def rounded(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: rounded(own) for key, own in value.items()}
        if isinstance(value, list):
            return [rounded(own) for own in value]
        return precision.dtype(value) if precision and isinstance(value, float) else value

    return rounded(thing.table())


def _places(tables: Tables) -> Iterator[tuple[str, str, Any]]:
    """The group, the name and the place in its group of each thing."""
    for group in KINDS:
        for place, table in enumerate(tables.get(group, [])):
            yield group, table["name"], place
    for name in tables.get("materials", {}):
        yield "materials", name, name


def _kind(group: str, table: Mapping[str, Any]) -> type[Thing]:
    if group == "materials":
        return Material
    kinds = {TYPES.get(kind.kind, POINT): kind for kind in KINDS[group]}
    return kinds[table.get("type", POINT)]


def _free_name(group: str, things: list[Any]) -> str:
    """The name that a file would give, or the next one that is free."""
    taken, place = {own["name"] for own in things}, len(things)
    while default_name(group, place) in taken:
        place += 1
    return default_name(group, place)
