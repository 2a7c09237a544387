"""One plugin of a Mitsuba dictionary: its parameters and children, read by name.

What is asked for is remembered. What is left at the end has no counterpart, and is a problem.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from .plugins import INDICES, KINDS, TAKEN
from .report import Report, choices, equals, nearest

# A number of the type of Mitsuba's default variants has seven digits
CLOSE = 1e-5
NO_PLUGIN = "there is no such plugin of Mitsuba"


class Node:
    """A plugin, where it is, and what has been asked of it.

    Args:
        path: keys from the root, with dots between them; empty for the scene.
        table: the dictionary of the plugin.
        ids: the path and the dictionary of each plugin that a reference can name.
    """

    def __init__(
        self, path: str, table: Mapping, report: Report, ids: Mapping[str, tuple[str, Mapping]]
    ) -> None:
        self.path, self.table, self.report, self.ids = path, table, report, ids
        self.asked = {"type", "id"}
        self.type = type_of(table)

    @property
    def name(self) -> str:
        """Its id, or else its key."""
        return str(self.table.get("id", self.path.rpartition(".")[2]))

    @property
    def kind(self) -> str | None:
        return KINDS.get(self.type)

    def at(self, key: str) -> str:
        """The path of a parameter."""
        return f"{self.path}.{key}" if self.path else key

    def told(self, key: str) -> str:
        """The path of a parameter, and its value."""
        return equals(self.at(key), self.table[key]) if key in self.table else self.at(key)

    def has(self, key: str) -> bool:
        """Whether the dictionary gives a parameter."""
        self.asked.add(key)
        return key in self.table

    def ignore(self, *keys: str) -> None:
        """Parameters that change no picture here."""
        self.asked.update(keys)

    def expect(self, key: str, expected: str) -> None:
        self.report.refuse(self.told(key), f"expected {expected}")

    def number(self, key: str, default: float, low: float = -np.inf, open_: bool = False) -> float:
        """A finite number, at least `low`, or greater than it if `open_`."""
        if not self.has(key):
            return default
        value = numbers(self.table[key], (1,))
        if value is None or value[0] < low or (open_ and value[0] == low):
            limit = "" if low == -np.inf else f" > {low:g}" if open_ else f" >= {low:g}"
            self.expect(key, f"a number{limit}" if limit else "a finite number")
            return default
        return float(value[0])

    def whole(self, key: str, default: int, low: int) -> int:
        """A whole number, at least `low`."""
        if not self.has(key):
            return default
        value = numbers(self.table[key], (1,))
        if value is None or value[0] != round(value[0]) or value[0] < low:
            self.expect(key, f"a whole number >= {low}")
            return default
        return int(value[0])

    def flag(self, key: str) -> bool:
        value = self.table.get(key, False) if self.has(key) else False
        if not isinstance(value, (bool, np.bool_)):
            self.expect(key, "True or False")
            return False
        return bool(value)

    def word(self, key: str, default: str, known: tuple[str, ...]) -> str:
        """One of some words."""
        value = self.table[key] if self.has(key) else default
        if not isinstance(value, str) or value not in known:
            near = nearest(value, known) if isinstance(value, str) else ""
            self.expect(key, f"{choices(known)}{near}")
            return default
        return str(value)

    def vector(self, key: str, default: tuple[float, ...]) -> np.ndarray:
        """Three finite numbers."""
        value = numbers(self.table[key], (3,)) if self.has(key) else np.array(default, float)
        if value is None:
            self.expect(key, "three finite numbers")
            return np.array(default, float)
        return value

    def matrix(self, key: str, size: int = 4) -> np.ndarray:
        """An affine transform."""
        if not self.has(key):
            return np.eye(size)
        value = self.table[key]
        value = numbers(getattr(value, "matrix", value), (size, size))
        if value is None or not np.allclose(value[-1], np.eye(size)[-1], atol=CLOSE):
            self.expect(key, f"an affine transform, a {size} x {size} matrix")
            return np.eye(size)
        return value

    def color(self, key: str, default: float, high: float = np.inf) -> list[float]:
        """Linear RGB, each channel in [0, high]."""
        if not self.has(key):
            return [default] * 3
        value: Any = self.table[key]
        if isinstance(value, Mapping):
            value = self._of_dictionary(key, value, grey=high == 1)
            if value is None:
                return [default] * 3
        found = numbers(value, (3,))
        if found is None and (one := numbers(value, (1,))) is not None:
            found = np.repeat(one, 3)
        if found is None or found.min() < 0 or found.max() > high:
            limit = "in [0, 1]" if high == 1 else ">= 0"
            self.expect(key, f"linear RGB, three numbers {limit}")
            return [default] * 3
        return found.tolist()

    def _of_dictionary(self, key: str, table: Mapping, grey: bool) -> Any:
        """The value of a dictionary that stands for a colour; None for one that was refused."""
        kind = type_of(table)
        more = [name for name in table if name not in ("type", "value", "id")]
        # Of a reflectance a spectrum with one number is grey; of a light it is tinted
        number = numbers(table.get("value"), (1,)) is not None
        if (
            "value" in table
            and not more
            and (kind == "rgb" or (kind == "spectrum" and grey and number))
        ):
            return table["value"]
        where = equals(f"{self.at(key)}.type", table.get("type"))
        if more and kind == "rgb":
            self.report.refuse(f"{self.at(key)}.{more[0]}", "unknown parameter of 'rgb'")
        elif kind == "spectrum":
            self.report.refuse(where, "spectra have no counterpart; expected 'rgb'")
        else:
            what = "this has no counterpart here; expected 'rgb'"
            unknown = f"{NO_PLUGIN}{nearest(kind, KINDS)}"
            self.report.refuse(where, what if kind in KINDS else unknown)
        return None

    def weight(self, key: str) -> float:
        """A grey weight in [0, 1]; 1 without one."""
        color = self.color(key, 1.0, 1.0)
        if max(color) == min(color):
            return color[0]
        why = "coloured weights have no counterpart"
        self.report.differ(self.told(key), why, "its mean is taken")
        return sum(color) / 3

    def index(self, key: str, default: str) -> float:
        """An index of refraction, a number or one of Mitsuba's names."""
        value = self.table[key] if self.has(key) else default
        if isinstance(value, str):
            if value.lower() not in INDICES:
                near = nearest(value.lower(), INDICES)
                self.expect(key, f"an index of refraction, or the name of a medium{near}")
            return INDICES.get(value.lower(), 1.0)
        return self.number(key, INDICES[default], 0, open_=True)

    def children(self, *kinds: str) -> list["Node"]:
        """The plugins in it of some kinds, references resolved, in their order."""
        found = {key: node for key, node in self._nested() if node.kind in kinds}
        self.asked.update(found)
        return list(found.values())

    def child(self, kind: str) -> "Node | None":
        """The only plugin in it of a kind."""
        found = self.children(kind)
        for more in found[1:]:
            self.report.refuse(more.path, f"a second {kind}; expected one")
        return found[0] if found else None

    def _nested(self) -> Iterator[tuple[str, "Node"]]:
        for key, value in self.table.items():
            if isinstance(value, Mapping) and KINDS.get(type_of(value)) != "value":
                path = self.at(str(key))
                if type_of(value) == "ref":
                    path, value = self.ids.get(str(value.get("id")), (path, value))
                yield str(key), Node(path, value, self.report, self.ids)

    def taken(self) -> bool:
        """Whether its type has a counterpart; one that has none is a problem."""
        if self.kind is not None and self.type in TAKEN.get(self.kind, ()):
            return True
        known = TAKEN.get(self.kind or "", ())
        what = f"this {self.kind} has no counterpart here"
        self.report.refuse(
            equals(self.at("type"), self.type),
            f"{what}; expected {choices(known)}" if known else what,
        )
        return False

    def finish(self) -> None:
        """A problem for each parameter and each child that nobody has asked for."""
        for key, value in self.table.items():
            if key not in self.asked:
                self._refuse_left(str(key), value)

    def _refuse_left(self, key: str, value: object) -> None:
        where, known = self.at(key), [name for name in self.asked if name not in ("type", "id")]
        if not isinstance(value, Mapping):
            what = f"unknown parameter of '{self.type}'{nearest(key, known)}"
            plain = isinstance(value, (str, bool)) or numbers(value) is not None
            if not plain:
                what = f"expected a dictionary, got an object of the type {type(value).__name__}"
            self.report.refuse(where, what)
            return
        kind, told = type_of(value), equals(f"{where}.type", value.get("type"))
        if "type" not in value:
            self.report.refuse(f"{where}.type", "missing; expected the name of a plugin")
        elif kind == "ref":
            name = str(value.get("id"))
            what = f"there is no such object{nearest(name, self.ids)}"
            if name in self.ids:
                self.report.refuse(where, f"'{name}' has no place in '{self.type}'")
            else:
                self.report.refuse(equals(f"{where}.id", value.get("id")), what)
        elif kind not in KINDS:
            self.report.refuse(told, f"{NO_PLUGIN}{nearest(kind, KINDS)}")
        else:
            self.report.refuse(told, f"'{kind}' in '{self.type}' has no counterpart here")


def type_of(table: Mapping[str, Any]) -> str:
    """The type of a plugin; empty where that is not a name."""
    name = table.get("type")
    return name if isinstance(name, str) else ""


def numbers(value: Any, shape: tuple[int, ...] | None = None) -> np.ndarray | None:
    """Finite numbers of a shape; None for what is something else.

    Args:
        value: a number, or numbers of Python, NumPy or Dr.Jit, of width 1.
        shape: None for any.
    """
    if isinstance(value, (str, bool, Mapping)):
        return None
    try:
        found = np.array(value)
        real = found.dtype.kind in "iuf" and np.isfinite(found).all()
        return found.astype(float).reshape(shape or found.shape) if real else None
    except (TypeError, ValueError, RuntimeError):
        return None
