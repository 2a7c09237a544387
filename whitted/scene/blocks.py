"""The text of a scene file as blocks: the header and the keys of a table, and its comments."""

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

__all__ = ["EMPTY_LINE", "Block", "blocks_of", "put_in", "take_out", "tomllib"]

EMPTY_LINE = "\n"


@dataclass
class Block:
    """One table of a file, and the lines above it."""

    path: tuple[str, ...] = ()  # the keys that lead to it; none for what stands outside of tables
    in_list: bool = False  # one of several with the same header, as in [[spheres]]
    gap: str = ""  # lines above that belong to no table
    comment: str = ""  # the comment directly above the header
    text: str = ""  # the header and the keys

    def __str__(self) -> str:
        return self.gap + self.comment + self.text


def blocks_of(text: str) -> list[Block]:
    """The blocks of a file.

    Returns:
        What stands before all tables, each table, and what stands behind them all.
    """
    blocks = [Block()]
    between: list[str] = []
    for line in text.removesuffix("\n").split("\n"):
        if not line.strip() or line.lstrip().startswith("#"):
            between.append(f"{line}\n")
        elif (header := _header_in(line)) is None:
            blocks[-1].text += "".join(between) + f"{line}\n"
            between = []
        else:
            after, gap, above = _shared_out(between)
            blocks[-1].text += after
            blocks.append(Block(*header, gap, above, f"{line}\n"))
            between = []
    after, gap, _ = _shared_out([*between, ""])
    blocks[-1].text += after
    return [*blocks, Block(gap=gap)]


def _header_in(line: str) -> tuple[tuple[str, ...], bool] | None:
    """The path of the table that a line begins, and whether it is one of a list."""
    if not line.lstrip().startswith("["):
        return None
    try:
        table = tomllib.loads(line)
    except tomllib.TOMLDecodeError:
        # A part of a value that takes several lines
        return None
    path: list[str] = []
    in_list = False
    while table:
        ((key, table),) = table.items()
        path.append(key)
        if in_list := isinstance(table, list):
            table = table[0]
    return tuple(path), in_list


def _shared_out(lines: Sequence[str]) -> tuple[str, str, str]:
    """Empty lines and comments between two tables: the first one's, nobody's, the second one's."""
    empty = [place for place, line in enumerate(lines) if not line.strip()]
    first, last = (empty[0], empty[-1] + 1) if empty else (0, 0)
    return "".join(lines[:first]), "".join(lines[first:last]), "".join(lines[last:])


def take_out(blocks: list[Block], block: Block) -> None:
    """Take a block and its own comment out of a file; other lines above it stay."""
    place = blocks.index(block)
    after = blocks[place + 1]
    after.gap = re.sub(r"\s+\Z", "\n", block.gap) + after.gap if block.gap.strip() else after.gap
    if not any(map(str, blocks[:place])):
        after.gap = after.gap.lstrip("\n")
    del blocks[place]


def put_in(blocks: list[Block], block: Block) -> None:
    """Put a block behind the others of its kind, or behind all tables."""
    kin = [place for place, each in enumerate(blocks) if each.path[:1] == block.path[:1]]
    place = kin[-1] + 1 if kin else len(blocks) - 1
    block.gap = EMPTY_LINE if any(map(str, blocks[:place])) else ""
    blocks.insert(place, block)
