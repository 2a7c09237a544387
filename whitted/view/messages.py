"""What a page says: one model for each kind of message, checked before anything is done."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

# A place in the picture: parts of its width and of its height, from the top left. A mouse that is
# held may leave the picture
Inside = Annotated[float, Field(ge=0, le=1)]
Place = Annotated[float, Field(ge=-10, le=10)]
Real = Annotated[float, Field(allow_inf_nan=False)]
Name = Annotated[str, Field(max_length=300)]
Steps = Annotated[float, Field(ge=-100, le=100)]
# The longest side, the most pixels and the most samples of a picture that is looked at
SIDE, PIXELS, SPP = 4096, 1 << 22, 256


class Message(BaseModel):
    """What all kinds have in common: other keys are refused, and texts are no numbers."""

    model_config = ConfigDict(extra="forbid", strict=True)


class Open(Message):
    """A page wants the whole scene."""

    kind: Literal["open"]


class Set(Message):
    """A parameter has other numbers: one, or three."""

    kind: Literal["set"]
    name: Name
    value: Annotated[list[Real], Field(min_length=1, max_length=3)]


class Prepare(Message):
    """A parameter is about to move."""

    kind: Literal["prepare"]
    name: Name


class Grab(Message):
    """The mouse takes the shape that is seen at a place, or what has a name, or the camera."""

    kind: Literal["grab"]
    x: Inside
    y: Inside
    what: Literal["shape", "light", "camera"]
    name: Name | None = None  # of the light
    through: bool = False  # look into mirrors and through glass


class Drag(Message):
    """Since `grab` the mouse has moved to a place."""

    kind: Literal["drag"]
    x: Place
    y: Place
    how: Literal["across", "along", "turn", "pan"]


class Wheel(Message):
    """The wheel was turned: the radius of what is picked, or the camera's distance."""

    kind: Literal["wheel"]
    steps: Steps
    camera: bool = False  # in any case the camera


class Select(Message):
    """A thing is picked by its name, or nothing is."""

    kind: Literal["select"]
    name: Name | None


class Keep(Message):
    """What moved is released: undo takes it back as one."""

    kind: Literal["keep"]


class Step(Message):
    """Undo, redo, or back to the scene as it was opened."""

    kind: Literal["undo", "redo", "reset"]


class Look(Message):
    """How pictures are made."""

    kind: Literal["look"]
    size: Annotated[list[Annotated[int, Field(ge=1, le=SIDE)]], Field(min_length=2, max_length=2)]
    spp: Annotated[int, Field(ge=1, le=SPP)]
    edges: bool
    moving_edges: bool
    depth: Annotated[int, Field(ge=1, le=256)]
    outline: bool
    labels: bool


class Differentiate(Message):
    """Show the derivative by a number, or none."""

    kind: Literal["differentiate"]
    name: Name | None
    component: Literal["x", "y", "z"] | None = None
    terms: Literal["both", "interior", "boundary"] = "both"
    shown: Literal["over", "beside"] = "over"


class Rest(Message):
    """Nothing moves: the picture may take its time."""

    kind: Literal["rest"]


class Save(Message):
    """Write the scene or the picture into the scene's folder."""

    kind: Literal["save"]
    name: Name
    replace: bool = False


class Target(Message):
    """The picture as it is now is the target, or there is none."""

    kind: Literal["target"]
    source: Literal["now", "none"]


class Fit(Message):
    """Start a fit of these parameters."""

    kind: Literal["fit"]
    wrt: Annotated[list[Name], Field(min_length=1, max_length=200)]


class Stop(Message):
    """Stop the fit; the best so far counts."""

    kind: Literal["stop"]


KINDS = (
    *(Open, Set, Prepare, Grab, Drag, Wheel, Select, Keep, Step, Look, Differentiate, Rest, Save),
    *(Target, Fit, Stop),
)
_adapters: dict[str, Any] = {
    kind: TypeAdapter(model)
    for model in KINDS
    for kind in model.model_fields["kind"].annotation.__args__  # type: ignore[union-attr]
}


def read(message: Any) -> Any:
    """The message that a page has sent.

    Args:
        message: JSON's dictionaries, lists, texts and numbers.

    Raises:
        ValueError: no such message; one line says what is wrong with it.
    """
    kind = message.get("kind") if isinstance(message, dict) else None
    if not (isinstance(kind, str) and kind in _adapters):
        raise ValueError(f"message: expected a kind, one of {', '.join(_adapters)}, got {kind!r}")
    try:
        return _adapters[kind].validate_python(message)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join([kind, *map(str, first["loc"])])
        said = first["msg"][0].lower() + first["msg"][1:]
        raise ValueError(f"{where}: {said}, got {str(first['input'])[:60]}") from None
