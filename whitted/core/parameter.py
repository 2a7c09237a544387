"""What a scene's things say of their own numbers: one table of parameters, from which all else is
made.

A class of things (a shape, a light, a material, the camera) is a dataclass. A field that is a
`parameter` has a name, a size, a range and a scale; one that is a `setting` can be written in a
file, but not differentiated. The checks of files and of `Scene.replace`, the names of parameters, a
fit's bounds and its steps are all read from these fields.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

# The largest number that is taken: squares of all lengths, and their reciprocals, fit single
# precision
LARGEST = 1e18
# How far a number may overstep a closed end in `Scene.replace`: steps of differences and of
# optimisers do, and the image goes on smoothly there
OVERSTEP = 0.01


@dataclass(frozen=True)
class Range:
    """The numbers that have a meaning, and how a message calls them: one number, or each of three."""

    one: str
    three: str = ""
    low: float = -math.inf
    high: float = math.inf
    open: bool = False  # the ends do not belong to it
    direction: bool = False  # three numbers that are not all 0

    def holds(self, x: float, overstep: float = 0.0) -> bool:
        """Whether a number lies in the range; a closed one may be overstepped by so much."""
        if not abs(x) <= LARGEST:
            return False
        if self.open:
            return self.low + 1 / LARGEST <= x < self.high
        return self.low - overstep <= x <= self.high + overstep

    def expected(self, size: int) -> str:
        """What a message says was expected."""
        return self.one if size == 1 else self.three


ANY = Range("a finite number", "three finite numbers")
POSITIVE = Range("a number > 0", low=0.0, open=True)
NON_NEGATIVE = Range("a number >= 0", "three numbers >= 0", low=0.0)
UNIT = Range("a number in [0, 1]", "three numbers in [0, 1]", low=0.0, high=1.0)
ANGLE = Range("an angle in degrees, in (0, 180)", low=0.0, high=180.0, open=True)
DIRECTION = Range("", "three finite numbers", direction=True)


@dataclass(frozen=True)
class Scale:
    """A large change of a number: a part of something."""

    part: float
    of: Literal["one", "value", "radius", "view"]
    # "value": the parameter itself; "radius": that of the same thing; "view": the distance of the
    # eye from what it looks at


# Directions and numbers between 0 and 1
SMALL_NUMBER = Scale(0.2, "one")


@dataclass(frozen=True)
class Parameter:
    """A number, or a vector of three, by which images are differentiable."""

    size: int  # 1 or 3
    legal: Range
    usual: Range  # where a fit looks for it
    scale: Scale
    default: Any  # MISSING where a file must give it
    neutral: float | None  # with this value the scene looks as if there were no such parameter


@dataclass(frozen=True)
class Setting:
    """What a file may say of a thing, and no gradient can change."""

    kind: Any  # the type that pydantic is to check
    default: Any


REQUIRED = dataclasses.MISSING


def parameter(
    size: int = 1,
    legal: Range = ANY,
    *,
    usual: Range | None = None,
    scale: Scale = SMALL_NUMBER,
    default: Any = REQUIRED,
    neutral: float | None = None,
) -> Any:
    """A dataclass's field that holds a parameter."""
    entry = Parameter(size, legal, usual or legal, scale, default, neutral)
    return dataclasses.field(metadata={"parameter": entry})


def setting(kind: Any, default: Any = REQUIRED) -> Any:
    """A dataclass's field that holds a setting."""
    return dataclasses.field(metadata={"setting": Setting(kind, default)})


@cache
def parameters_of(kind: Any) -> Mapping[str, Parameter]:
    """The parameters of a class of things, by field."""
    return {field.name: field.metadata["parameter"] for field in _fields(kind, "parameter")}


@cache
def settings_of(kind: Any) -> Mapping[str, Setting]:
    """The settings of a class of things, by field."""
    return {field.name: field.metadata["setting"] for field in _fields(kind, "setting")}


def _fields(kind: Any, entry: str) -> list[dataclasses.Field]:
    return [field for field in dataclasses.fields(kind) if entry in field.metadata]
