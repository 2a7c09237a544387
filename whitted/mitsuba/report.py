"""What is found on the way between the two kinds of scene: problems, and warnings."""

import difflib
import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass
class Report:
    """What cannot be taken, and what is taken though it differs; a line for each."""

    approximate: bool = False
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def refuse(self, where: str, why: str) -> None:
        """A problem, always."""
        _add(self.problems, f"{where}: {why}")

    def differ(self, where: str, why: str, instead: str) -> None:
        """A problem; or, if it may be approximate, a warning that says what is done instead."""
        if self.approximate:
            self.warn(where, f"{why}; {instead}")
        else:
            self.refuse(where, f"{why}; with approximate=True {instead}")

    def warn(self, where: str, what: str) -> None:
        """A warning, always: the scene is taken, and this may change its picture."""
        _add(self.warnings, f"{where}: {what}")


def _add(lines: list[str], line: str) -> None:
    """Add a line that is not there yet: what several things share is read for each of them."""
    if line not in lines:
        lines.append(line)


def equals(path: str, value: object) -> str:
    """A path and the value there, as messages write them."""
    return f"{path} = {shown(value)}"


def shown(value: object) -> str:
    """A value as messages write it, on one line and not too long."""
    try:
        text = json.dumps(value, default=_listed)
    except (TypeError, ValueError, RecursionError):
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def _listed(value: Any) -> Any:
    """An array as lists, and any other object by its type."""
    array = np.array(value)
    return f"<{type(value).__name__}>" if array.dtype.kind not in "biuf" else array.tolist()


def nearest(name: str, known: Iterable[str]) -> str:
    """The known name that is most like another, as the end of a message."""
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    return f"; did you mean '{near[0]}'?" if near else ""


def choices(names: Iterable[str]) -> str:
    """Names as a message lists them."""
    *most, last = (f"'{name}'" for name in names)
    return f"{', '.join(most)} or {last}" if most else last
