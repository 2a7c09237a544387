"""Light that comes from no thing in the scene."""

from dataclasses import dataclass

from ..core.arrays import Array
from ..core.parameter import ANY, NON_NEGATIVE, parameter


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What a scene has beside its things."""

    # Radiance of a ray that leaves the scene
    background: Array = parameter(3, ANY, usual=NON_NEGATIVE, default=0)
    # Ambient radiance, which multiplies the albedo
    ambient: Array = parameter(3, ANY, usual=NON_NEGATIVE, default=0, neutral=0)
