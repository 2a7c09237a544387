"""What of the documentation is made of the code.

Tables stand in the pages, so that they can be read without building anything. After a change of the
code, `.venv/bin/python docs/generate.py` writes them anew; `tests/test_docs.py` tells when that is
needed. Pictures are drawn at each build of the site, of which this is an extension.
"""

import inspect
import re
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pictures
from typer.models import ArgumentInfo

import whitted
from whitted import cli, mitsuba
from whitted.core.parameter import parameters_of
from whitted.scene import tables, things
from whitted.scene.camera import Camera
from whitted.scene.material import Material
from whitted.scene.scene import Scene
from whitted.scene.surroundings import Surroundings
from whitted.scene.texture import Checkerboard

OUTPUT = Path(__file__).parent / "_generated"
PAGES = sorted(Path(__file__).parent.glob("*.md"))
# Each table of a scene file: its model, what it is in the code, and whose docstring explains it
TABLES = {
    "scene": (tables.SceneTable, Surroundings, Scene),
    "camera": (tables.CameraTable, Camera, things.Camera),
    "materials": (tables.MaterialTable, Material, things.Material),
    "checker": (tables.CheckerTable, Checkerboard, things.Checkerboard),
    **{kind.group: (kind.model(), kind.kind, kind) for kind in things.SHAPES},
    **{name: (table, tables.LIGHTS[name], None) for name, table in tables.LIGHT_TABLES.items()},
}
BY_LIGHT = {"point": things.PointLight, "directional": things.DirectionalLight}
# Keys that constructors lack, or that a file takes otherwise
OTHERS = {
    "type": "which kind of light it is",
    "material": "the name of one of the `materials`",
    "falloff": '`"inverse-square"` divides by the squared distance, `"none"` does not',
    "reflection": "weight of the mirrored ray",
    "refraction": "weight of the refracted ray",
    "radius": "of the shape, in the scene's unit of length",
    "spheres": "center and radius of each sphere, or the name of a file of them",
    "position": "the point where it is",
    "look_at": "a point in the middle of the picture",
}


def arguments_of(described: Any) -> dict[str, str]:
    """What the docstring of a constructor says of each argument."""
    text = inspect.getdoc(described.__init__) or ""
    section = re.search(r"Args:\n(.*?)(?:\n\n|\Z)", text, re.S)
    if section is None:
        raise ValueError(f"{described}: no Args in the docstring")
    said = {}
    for names, words in re.findall(r"^    (\S[^:]*): (.*(?:\n     .*)*)", section[1], re.M):
        words = re.sub(r"\s+", " ", words)
        # Another column has the range
        words = re.sub(r",? ?(in [\[(][\d, ]+[\])]|from \d+ to \d+|>=? 0)(?=[.;])", "", words)
        said.update(dict.fromkeys(names.split(", "), words.removesuffix(".")))
    return said


def expected(field: Any) -> str:
    """What a message says of a value that a key does not take."""
    for check in field.metadata:
        if hasattr(check, "func"):
            try:
                check.func(None)
            except ValueError as error:
                return str(error).removeprefix("expected ")
    if field.annotation is bool:
        return "true or false"
    choices = [f'"{one}"' for one in get_args(field.annotation) if isinstance(one, str)]
    return " or ".join(choices) or ("a name" if field.annotation is not None else "")


def default(field: Any) -> str:
    """A key's default as a file has it."""
    if field.is_required():
        return "required"
    value = field.default
    if value is None:
        return "none"
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return f'`"{value}"`' if isinstance(value, str) else f"`{text}`"


def keys_of(name: str) -> str:
    """The keys of a table, as a table of Markdown."""
    model, kind, described = TABLES[name]
    said = {**arguments_of(described or BY_LIGHT[name]), **OTHERS}
    lines = ["| key | meaning | takes | default | gradient |", "|---|---|---|---|---|"]
    for key, field in model.model_fields.items():
        # Tables within tables have sections of their own
        if key in {"camera", "materials", "lights", "checker", *tables.GROUPS}:
            continue
        mark = "yes" if key in parameters_of(kind) or key == "spheres" else ""
        takes = expected(field)
        lines.append(f"| `{key}` | {said[key]} | {takes} | {default(field)} | {mark} |")
    return "\n".join(lines) + "\n"


def command_line() -> str:
    """Each command: what it does, its arguments and options, and examples."""
    return "\n".join(_command(each.callback, each.epilog) for each in cli.app.registered_commands)


def _command(function: Any, epilog: str) -> str:
    hints = get_type_hints(function, include_extras=True)
    given = inspect.signature(function).parameters
    rows = [_row(name, *get_args(hints[name])[:2], given[name]) for name in given]
    heads = ["| argument or option | meaning | default |", "|---|---|---|"] if rows else []
    label, _, examples = epilog.partition(":")
    shown = [f"    {' '.join(one.split())}" for one in examples.split("   |   ")]
    lines = [f"## whitted {function.__name__}", "", inspect.getdoc(function) or "", ""]
    return "\n".join([*lines, *heads, *rows, "", f"{label}:", "", *shown]) + "\n"


def _row(name: str, kind: Any, about: Any, given: inspect.Parameter) -> str:
    """An argument of a command's function, as a row of a table."""
    meaning, _, default = about.help.removesuffix(".").removesuffix("]").partition(" [default: ")
    meaning = meaning.removesuffix(".") + "."
    if choices := [f"`{one}`" for one in get_args(kind) if isinstance(one, str)]:
        meaning += f" One of {', '.join(choices)}."
    return f"| {_typed(name, about)} | {meaning} | {default or _default_of(given)} |"


def _typed(name: str, about: Any) -> str:
    """What to type for an argument of a command's function."""
    if isinstance(about, ArgumentInfo):
        return f"`{name.upper()}`"
    # The first one stands where a default may
    names = [each for each in (about.default, *(about.param_decls or ())) if isinstance(each, str)]
    names = names or [f"--{name.replace('_', '-')}"]
    *others, last = names
    value = f" {about.metavar}" if about.metavar else ""
    return ", ".join(f"`{each}`" for each in [*others, last + value])


def _default_of(given: inspect.Parameter) -> str:
    """A default that the help does not say."""
    if given.default is given.empty:
        return "required"
    return "" if given.default in (None, False) else f"`{given.default}`"


def part(name: str) -> str:
    """The part of a page that has this name."""
    kind, _, table = name.partition("-")
    if kind == "keys":
        return keys_of(table)
    if name == "mitsuba":
        return (inspect.getdoc(mitsuba) or "").split("\n\n", 2)[2] + "\n"
    return command_line()


def refreshed(text: str) -> str:
    """The text of a page with its parts as they are now."""
    return re.sub(
        r"(<!-- ([\w-]+): made by docs/generate.py -->\n).*?(<!-- end -->)",
        lambda found: f"{found[1]}\n{part(found[2])}\n{found[3]}",
        text,
        flags=re.S,
    )


def draw(app: Any) -> None:
    """Draw all pictures."""
    OUTPUT.mkdir(exist_ok=True)
    pictures.draw_all(OUTPUT)


def setup(app: Any) -> dict[str, Any]:
    app.connect("builder-inited", draw)
    return {"version": whitted.__version__, "parallel_read_safe": True}


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(refreshed(page.read_text()))
