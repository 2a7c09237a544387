"""Mitsuba's XML files, which Mitsuba itself reads, as dictionaries."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any


class XMLError(ValueError):
    """An XML file that Mitsuba cannot read; the message says why."""


def load(path: Path) -> dict[str, Any]:
    """The dictionary of an XML file.

    A plugin without an id has its kind for a key, with a number in the scene: "shape0".

    Raises:
        RuntimeError: there is no Mitsuba.
        XMLError: the file cannot be read.
    """
    try:
        import mitsuba
        from mitsuba import parser
    except ImportError:
        raise RuntimeError(
            "XML is read by Mitsuba, which is missing; install it with: "
            "pip install 'whitted[mitsuba]'"
        ) from None
    if mitsuba.variant() is None:
        # Without one Mitsuba reads no transform and no colour
        mitsuba.set_variant("scalar_rgb")
    config: Any = parser.ParserConfig(mitsuba.variant() or "")
    try:
        state = parser.parse_file(config, str(path))
        parser.transform_upgrade(config, state)
    except RuntimeError as error:
        raise XMLError(" ".join(str(error).split())) from None
    return dict(_table(state, 0))


def _table(state: Any, index: int) -> Iterator[tuple[str, Any]]:
    """The keys of a plugin, and their values."""
    node = state.nodes[index]
    props = node.props
    yield "type", props.plugin_name()
    if props.id() and index:
        yield "id", props.id()
    counts: dict[str, int] = {}
    for key in list(props):
        value = props[key]
        name = type(value).__name__
        if name == "ResolvedReference":
            child = state.nodes[value.index()]
            yield _key(key, child, counts, not index), dict(_table(state, value.index()))
        elif name == "Reference":
            own = key if not key.startswith("_arg_") else f"ref{key[5:]}"
            yield own, {"type": "ref", "id": value.id()}
        elif name == "Spectrum":
            numbers = list(value.values)
            yield key, {"type": "spectrum", "value": numbers[0] if value.is_uniform() else numbers}
        else:
            yield key, value


def _key(key: str, child: Any, counts: dict[str, int], top: bool) -> str:
    """The key of a nested plugin: its own, its id, or its kind."""
    if not key.startswith("_arg_"):
        return key
    if child.props.id():
        return str(child.props.id())
    kind = {"ReconstructionFilter": "rfilter"}.get(child.type.name, child.type.name.lower())
    number = counts.get(kind, 0)
    counts[kind] = number + 1
    many = top and kind in ("shape", "emitter", "bsdf", "texture")
    return f"{kind}{number}" if many or number else kind
