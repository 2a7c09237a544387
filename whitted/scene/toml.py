"""Scene files as text: read into tables, and written from them."""

import re
import sys
from typing import Any

from .dictionary import dictionary_of, without_default_names
from .schema import SceneError, default_name
from .tables import GROUPS

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

# Of the order of bytes, with which some editors begin a file
MARK = "\ufeff"


def tables_in(text: str, where: str = "") -> dict[str, Any]:
    """The tables of a scene file, unchecked.

    Args:
        where: the file, for messages.

    Raises:
        SceneError: it is not TOML.
    """
    place = where
    try:
        return tomllib.loads(text.removeprefix(MARK))
    except tomllib.TOMLDecodeError as error:
        told = re.sub(r" *[(]at .*[)]$", "", str(error))
        if at := re.search(r"\(at line (\d+), column (\d+)\)", str(error)):
            place = f"{where or 'text'}:{at[1]}:{at[2]}"
    except (RecursionError, ValueError) as error:
        told = str(error)
    raise SceneError(f"{place or 'text'}: not valid TOML: {told}")


def text_of(scene: Any) -> str:
    """The text of a scene's file."""
    import tomlkit

    tables = without_default_names(dictionary_of(scene))
    if "materials" in tables:
        materials = tables["materials"].items()
        tables["materials"] = {name: _with_board_in_line(own) for name, own in materials}
    return tomlkit.dumps(tables)


def edited_text(text: str, before: Any, scene: Any) -> str:
    """The text of a file with what a scene says otherwise; all else stays as it is written.

    Args:
        before: the scene of the text.
    """
    import tomlkit

    old, new = dictionary_of(before, whole=True), dictionary_of(scene, whole=True)
    if old == new:
        return text
    document = tomlkit.parse(text.removeprefix(MARK))
    # What is new has no defaults to write
    for group, own in dictionary_of(scene).items():
        if group == "materials":
            new[group] |= {name: own[name] for name in own.keys() - old.get(group, {}).keys()}
        elif group in GROUPS or group == "lights":
            known = {each["name"] for each in old.get(group, [])}
            pairs = zip(new[group], own, strict=True)
            new[group] = [one if one["name"] in known else short for one, short in pairs]
    for group in (*GROUPS, "lights"):
        _edit_list(document, group, old.pop(group, []), new.pop(group, []))
    if "materials" in new and "materials" not in old:
        document["materials"], old["materials"] = tomlkit.table(is_super_table=True), {}
    _edit(document, old, new)
    return tomlkit.dumps(document)


def _edit_list(document: Any, group: str, old: list[Any], new: list[Any]) -> None:
    """Edit a list of things; all have names, but for those in the document."""
    import tomlkit

    left = {own["name"] for own in new}
    for place in reversed(range(len(old))):
        if old[place]["name"] not in left:
            del document[group][place]
    if not left & {own["name"] for own in old} and (old or new):
        # An empty list does not stay: it may stand where a table cannot
        document.pop(group, None)
    known = {own["name"]: own for own in old}
    for place, own in enumerate(new):
        name = own["name"]
        if name in known:
            table = document[group][place]
            _edit(table, known[name], own)
            if "name" not in table and name != default_name(group, place):
                table["name"] = name
        else:
            if name == default_name(group, place):
                own = {key: value for key, value in own.items() if key != "name"}
            if group not in document:
                _end_with_empty_line(document)
                document[group] = tomlkit.aot()
            things = document[group]
            if isinstance(things, tomlkit.items.AoT):
                if things:
                    _end_with_empty_line(things[-1])
                own = _new_table(own)
            things.append(own)


def _edit(document: Any, old: dict[str, Any], new: dict[str, Any]) -> None:
    """Edit a table where its new keys differ from the old ones."""
    for key in old.keys() - new.keys():
        del document[key]
    for key, value in new.items():
        before = old.get(key)
        if isinstance(value, dict) and before is not None:
            _edit(document[key], before, value)
        elif key == "checker":
            document[key] = _in_line(value)
        elif value != before:
            document[key] = _new_table(value) if isinstance(value, dict) else value


def _end_with_empty_line(table: Any) -> None:
    import tomlkit

    if not table.as_string().endswith("\n\n"):
        table.add(tomlkit.nl())


def _new_table(own: dict[str, Any]) -> Any:
    """A table with an empty line behind it."""
    import tomlkit

    table = tomlkit.item(_with_board_in_line(own))
    table.add(tomlkit.nl())
    return table


def _with_board_in_line(own: dict[str, Any]) -> dict[str, Any]:
    """A material's table whose checkerboard takes one line; another table stays as it is."""
    return own | {"checker": _in_line(own["checker"])} if "checker" in own else own


def _in_line(own: dict[str, Any]) -> Any:
    """A table to be written in one line."""
    import tomlkit

    table = tomlkit.inline_table()
    table.update(own)
    return table
