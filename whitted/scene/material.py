"""Materials."""

from dataclasses import dataclass

from pydantic import StrictBool

from ..core.arrays import Array
from ..core.parameter import NON_NEGATIVE, POSITIVE, UNIT, Range, Scale, parameter, setting
from .texture import Checkerboard

# An index below 1 is legal, but rarely meant
FROM_ONE = Range("a number >= 1", low=1.0)


@dataclass(frozen=True)
class Material:
    """How a surface shades, reflects and refracts.

    What has its neutral value, and was never replaced, is left out of kernels.
    """

    name: str
    # Lambertian albedo, linear RGB
    color: Array = parameter(3, UNIT, default=0, neutral=0)
    # Blinn-Phong coefficient and exponent
    specular: Array = parameter(1, NON_NEGATIVE, default=0, neutral=0)
    shininess: Array = parameter(1, POSITIVE, default=50, scale=Scale(1 / 2, "value"))
    # Weights of the mirrored and of the refracted ray
    reflection: Array = parameter(1, UNIT, default=0, neutral=0)
    refraction: Array = parameter(1, UNIT, default=0, neutral=0)
    # Index of refraction
    ior: Array = parameter(1, POSITIVE, usual=FROM_ONE, default=1.5)
    # The part of a light that it keeps away from what lies behind it
    shadow: Array = parameter(1, UNIT, default=1, neutral=1)
    # Whether the weights are shared out by the Fresnel equations
    fresnel: bool = setting(StrictBool, False)
    checker: Checkerboard | None = None
