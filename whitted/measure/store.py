"""A file of measurements, so that an interrupted run can be resumed."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..files.atomic import write_text

# Measurements: a dictionary for each
Rows = list[dict[str, Any]]


class Store:
    """Groups of measurements, kept in a JSON file.

    Args:
        path: the file; one that is missing, damaged, or of other conditions is replaced.
        conditions: what the measurements depend on.
    """

    def __init__(self, path: Path, conditions: dict[str, Any]) -> None:
        self.path, self.conditions, self.groups = path, conditions, dict[str, Rows]()
        try:
            kept = json.loads(path.read_text(encoding="utf-8"))
            if kept["conditions"] == conditions:
                self.groups = kept["groups"]
        except (OSError, ValueError, KeyError, TypeError):
            pass  # no file, or not one of ours: measure everything

    def group(self, name: str, measure: Callable[[], Rows]) -> Rows:
        """The group of this name: the stored one, or else a new one, which is then stored."""
        if name not in self.groups:
            self.groups[name] = measure()
            text = json.dumps({"conditions": self.conditions, "groups": self.groups}, indent=1)
            write_text(self.path, text)
        return self.groups[name]
