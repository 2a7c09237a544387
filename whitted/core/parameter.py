"""The one table of parameters: what each kind of thing says of its own numbers.

A kind of thing (a shape, a light, a material, the camera) is a dataclass. A field that is a
`parameter` has a size, a legal range and a scale; images are differentiable by it. A field that is
a `setting` can be written in a file, but has no derivative. All else is read from these fields: the
names of parameters, the checks of files and of `Scene.replace`, and the bounds and steps of a fit.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

# The value of one parameter
Numbers = tuple[float, ...]

# The largest number that is taken: squares of all lengths, and their reciprocals, fit single
# precision
LARGEST = 1e18
# How far a number may overstep a closed end in `Scene.replace`. Steps of optimisers and of central
# differences do, and the image goes on smoothly there; a larger value would let mistakes pass.
OVERSTEP = 0.01


@dataclass(frozen=True)
class Range:
    """The numbers that have a meaning, and how a message names one of them, or three."""

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

    def expected(self, size: int, given: Iterable[float] = ()) -> str:
        """What a message says was expected.

        Args:
            given: the numbers that were not taken; finite ones may be too large, or too small.
        """
        words = self.one if size == 1 else self.three
        given = list(given)
        if any(LARGEST < abs(x) < math.inf and self.low <= x <= self.high for x in given):
            return f"{words}, of at most {LARGEST:g}"
        if self.open and any(self.low < x < self.low + 1 / LARGEST for x in given):
            return f"{words}, of at least {self.low + 1 / LARGEST:g}"
        return words


ANY = Range("a finite number", "three finite numbers")
POSITIVE = Range("a number > 0", low=0.0, open=True)
NON_NEGATIVE = Range("a number >= 0", "three numbers >= 0", low=0.0)
UNIT = Range("a number in [0, 1]", "three numbers in [0, 1]", low=0.0, high=1.0)
ANGLE = Range("an angle in degrees, in (0, 180)", low=0.0, high=180.0, open=True)
DIRECTION = Range("", "three finite numbers", direction=True)


@dataclass(frozen=True)
class Scale:
    """A large change of a number, as a part of something: the longest step of a fit.

    Of "one", of the parameter's own "value", of the "radius" of the same shape, or of the "view":
    the distance from the camera's position to what it looks at.
    """

    part: float
    of: Literal["one", "value", "radius", "view"]


# Of directions, and of numbers between 0 and 1
A_FIFTH = Scale(0.2, "one")


@dataclass(frozen=True)
class Parameter:
    """A number, or a vector of three, by which images are differentiable."""

    size: int  # 1 or 3
    legal: Range
    usual: Range  # where a fit looks for it
    scale: Scale
    default: Any  # REQUIRED where a file must give it
    neutral: float | None  # the value with which the code that reads it can be left out
    many: bool  # there is one for each sphere of a cloud


@dataclass(frozen=True)
class Setting:
    """What a file may say of a thing, without a derivative."""

    kind: Any  # the type that pydantic checks
    default: Any


REQUIRED = dataclasses.MISSING


def parameter(
    size: int = 1,
    legal: Range = ANY,
    *,
    usual: Range | None = None,
    scale: Scale = A_FIFTH,
    default: Any = REQUIRED,
    neutral: float | None = None,
    many: bool = False,
) -> Any:
    """A dataclass's field that holds a parameter."""
    entry = Parameter(size, legal, usual or legal, scale, default, neutral, many)
    return dataclasses.field(metadata={"parameter": entry})


def setting(kind: Any, default: Any = REQUIRED) -> Any:
    """A dataclass's field that holds a setting."""
    return dataclasses.field(metadata={"setting": Setting(kind, default)})


def parameters_of(kind: Any) -> Mapping[str, Parameter]:
    """The parameters of a kind of thing, by field."""
    return _entries(kind, "parameter")


def settings_of(kind: Any) -> Mapping[str, Setting]:
    """The settings of a kind of thing, by field."""
    return _entries(kind, "setting")


@cache
def _entries(kind: Any, what: str) -> dict[str, Any]:
    fields = dataclasses.fields(kind)
    return {field.name: field.metadata[what] for field in fields if what in field.metadata}
