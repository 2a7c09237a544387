"""Scene files as text: read into tables, and written from them."""

import re
from typing import Any

from .blocks import tomllib
from .dictionary import dictionary_of, without_default_names
from .editing import as_written
from .schema import SceneError

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
        tables["materials"] = {name: as_written(own) for name, own in tables["materials"].items()}
    if "clouds" in tables:
        tables["clouds"] = [as_written(own) for own in tables["clouds"]]
    return tomlkit.dumps(tables)
