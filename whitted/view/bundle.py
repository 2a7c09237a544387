"""The scripts of the page as one module, for notebooks, which load a widget from one text."""

import re
from pathlib import Path

STATIC = Path(__file__).parent / "static"
IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./([\w.]+)";$', re.M)
EXPORT = re.compile(r"^export ((?:async )?function (\w+))", re.M)


def bundled(entry: str) -> str:
    """A script and all that it imports, as one module; the exports are those of the script.

    Each of the others becomes a function of its own, so that names do not meet.
    """
    parts: dict[str, str] = {}
    last = _with_imports(entry, parts)
    return "\n".join(["const modules = {};", *parts.values(), last])


def _with_imports(name: str, parts: dict[str, str]) -> str:
    """The text of a script whose imports are taken from `modules`.

    Args:
        parts: gets what it imports, in an order in which it can run.
    """
    text = (STATIC / name).read_text(encoding="utf-8")
    for _, other in IMPORT.findall(text):
        if other not in parts:
            own = _with_imports(other, parts)
            names = ", ".join(name for _, name in EXPORT.findall(own))
            body = EXPORT.sub(r"\1", own)
            parts[other] = f'modules["{other}"] = (() => {{\n{body}\nreturn {{ {names} }};\n}})();'
    return IMPORT.sub(r'const \1 = modules["\2"];', text)
