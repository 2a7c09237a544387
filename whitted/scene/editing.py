"""A scene file with changes: what still holds stays as it is written, with its comments."""

from typing import Any

from .blocks import EMPTY_LINE, Block, blocks_of, put_in, take_out, tomllib
from .dictionary import dictionary_of
from .rows import Rows
from .schema import default_name
from .tables import GROUPS

LISTS = (*GROUPS, "lights")
Tables = dict[str, Any]
# The group and the name of a thing
Entry = tuple[str, str]


def edited_text(text: str, before: Any, scene: Any) -> str:
    """The text of a file with what a scene says otherwise; all else stays as it is written.

    Args:
        before: the scene of the text.
    """
    old, new = dictionary_of(before, whole=True), dictionary_of(scene, whole=True)
    if old == new:
        return text
    ending = "\r\n" if "\r\n" in text else "\n"
    blocks = blocks_of(text.replace("\r\n", "\n"))
    in_lines = _groups_in_lines(blocks)
    _name(blocks, old)
    places = {
        (group, own["name"]): place
        for group in LISTS
        for place, own in enumerate(new.get(group, ()))
    }
    old, new = _by_name(old), _by_name(new)
    added = _new_entries(dictionary_of(scene), old, new, in_lines)
    for block in sorted(blocks[1:-1], key=lambda each: -len(each.path)):
        own = _pop(old, block.path), _pop(new, block.path)
        if own[1] is None:
            take_out(blocks, block)
        else:
            _edit_block(block, *own, places)
    _edit_root(blocks, old, new, {group for group, _ in added})
    _arrange(blocks, places, added)
    return "".join(map(str, blocks)).replace("\n", ending)


def _groups_in_lines(blocks: list[Block]) -> set[str]:
    """The groups whose things are values of keys, and not tables with headers."""
    root = tomllib.loads(blocks[0].text)
    return {group for group in (*LISTS, "materials") if root.get(group)}


def _name(blocks: list[Block], old: Tables) -> None:
    """Put the names of things into the paths of their blocks."""
    for group in LISTS:
        own = [block for block in blocks if block.in_list and block.path == (group,)]
        for block, table in zip(own, old.get(group, ()), strict=False):
            block.path = group, table["name"]


def _by_name(tables: Tables) -> Tables:
    """The tables with dictionaries by name in place of lists of things."""
    lists = {group: {own["name"]: own for own in tables.get(group, ())} for group in LISTS}
    return {"materials": {}, **tables, **lists}


def _new_entries(
    short: Tables, old: Tables, new: Tables, in_lines: set[str]
) -> dict[Entry, Tables]:
    """Take out what only the new tables have and gets a header of its own.

    Args:
        short: the new tables without defaults, which are not written.
    """
    found = {}
    short = _by_name(short)
    for group in (*LISTS, "materials"):
        for name in [name for name in new[group] if name not in old[group]]:
            new[group][name] = short[group][name]
            if group not in in_lines:
                found[group, name] = new[group].pop(name)
    return found


def _pop(tables: Tables, path: tuple[str, ...]) -> Any:
    for key in path[:-1]:
        tables = tables.get(key, {})
    return tables.pop(path[-1], None)


def _edit_block(block: Block, old: Tables, new: Tables, places: dict[Entry, int]) -> None:
    """Edit the text of a block where the new table differs from the old one."""
    import tomlkit

    document = tomlkit.parse(block.text)
    table: Any = document
    if block.in_list:
        group, name = block.path
        table = document[group][0]
        if "name" not in table and name != default_name(group, places[group, name]):
            table["name"] = name
    else:
        for key in block.path:
            table = table[key]
    _edit(table, old, new)
    block.text = tomlkit.dumps(document)


def _edit_root(blocks: list[Block], old: Tables, new: Tables, added: set[str]) -> None:
    """Edit what stands before all tables.

    Args:
        added: groups of things that get headers of their own.
    """
    import tomlkit

    root, first = blocks[:2]
    document = tomlkit.parse(root.text)
    for group in LISTS:
        own, after = old.pop(group), new.pop(group)
        if own:
            _edit_list(document, group, list(own.values()), list(after.values()))
        elif group in document and group in added:
            # An empty list
            del document[group]
    _edit(document, old, new)
    text = tomlkit.dumps(document)
    if text and not root.text and not first.gap:
        first.gap = EMPTY_LINE
    root.text = text


def _arrange(blocks: list[Block], places: dict[Entry, int], added: dict[Entry, Tables]) -> None:
    """Put in new blocks, and move others, so that things stand in their order."""
    for entry in _out_of_order(blocks, places, added):
        moved = [block for block in blocks if block.path == entry]
        for block in moved:
            take_out(blocks, block)
        for block in moved or [_new_block(entry, added.pop(entry), places[entry])]:
            put_in(blocks, block)
    for entry, table in added.items():
        put_in(blocks, _new_block(entry, table))


def _out_of_order(
    blocks: list[Block], places: dict[Entry, int], added: dict[Entry, Tables]
) -> list[Entry]:
    """The things of lists that are new or stand too early, and all of their kind after them."""
    stand = {block.path: place for place, block in enumerate(blocks) if block.in_list}
    last: dict[str, int] = {}
    found = []
    for entry in (each for each in places if each in stand or each in added):
        group, place = entry[0], stand.get(entry, len(blocks))
        if place == len(blocks) or place < last.get(group, 0):
            found.append(entry)
            place = len(blocks)
        last[group] = place
    return found


def _new_block(entry: Entry, table: Tables, place: int | None = None) -> Block:
    """The block of a new thing.

    Args:
        place: in its list; None for a material.
    """
    import tomlkit

    group, name = entry
    table = as_written(table)
    if place is None:
        text = tomlkit.dumps({group: {name: table}})
        return Block(entry, text=text.replace(f"[{group}]\n", "", 1))
    if name == default_name(group, place):
        del table["name"]
    return Block(entry, in_list=True, text=tomlkit.dumps({group: [table]}))


def _edit_list(document: Any, group: str, old: list[Tables], new: list[Tables]) -> None:
    """Edit a list of inline tables; all have names, but for those in the document."""
    names = [own["name"] for own in new]
    for place in reversed(range(len(old))):
        if old[place]["name"] not in names:
            del document[group][place]
    known = {own["name"]: own for own in old}
    for place, own in enumerate(new):
        name = own["name"]
        if name not in known:
            document[group].append(_in_line(own))
            continue
        table = document[group][place]
        _edit(table, known[name], own)
        if "name" not in table and name != default_name(group, place):
            table["name"] = name


def _edit(document: Any, old: Tables, new: Tables) -> None:
    """Edit a table where its new keys differ from the old ones."""
    for key in old.keys() - new.keys():
        # A default is not written
        document.pop(key, None)
    for key, value in new.items():
        before = old.get(key)
        if isinstance(value, dict) and before is not None:
            if value != before:
                _edit(document[key], before, value)
        elif isinstance(value, dict):
            document[key] = _in_line(value)
        elif value != before:
            document[key] = as_written({key: value})[key]


def as_written(own: Tables) -> Tables:
    """A thing's table as a file has it: a checkerboard in one line, a cloud perhaps as a file."""
    own = {key: value.written() if isinstance(value, Rows) else value for key, value in own.items()}
    return own | {"checker": _in_line(own["checker"])} if "checker" in own else own


def _in_line(own: Tables) -> Any:
    """A table to be written in one line."""
    import tomlkit

    table = tomlkit.inline_table()
    table.update(as_written(own))
    return table
