"""Pages and pictures of the documentation that are made of the code: an extension of Sphinx.

They are parts of other pages, which include them from `_generated/`.
"""

import contextlib
import inspect
import io
import os
import re
from pathlib import Path
from typing import Any, get_args

import pictures

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
        mark = "yes" if key in parameters_of(kind) else ""
        takes = expected(field)
        lines.append(f"| `{key}` | {said[key]} | {takes} | {default(field)} | {mark} |")
    return "\n".join(lines) + "\n"


def command_line() -> str:
    """The help of each command, as `--help` prints it."""
    os.environ.update(COLUMNS="90", TERMINAL_WIDTH="90", NO_COLOR="1")
    names = [command.name or command.callback.__name__ for command in cli.app.registered_commands]
    parts = []
    for name in ["", *names]:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            cli.run([name, "--help"] if name else ["--help"])
        parts.append(f"## whitted {name}".strip() + f"\n\n```text\n{printed.getvalue()}```\n")
    return "\n".join(parts)


def write(name: str, text: str) -> None:
    """Write a page, unless it is as it was: Sphinx then reads it anew."""
    path = OUTPUT / name
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


def generate(app: Any) -> None:
    """Write all pages and pictures."""
    OUTPUT.mkdir(exist_ok=True)
    for name in TABLES:
        write(f"keys-{name}.md", keys_of(name))
    write("command-line.md", command_line())
    write("mitsuba.md", (inspect.getdoc(mitsuba) or "").split("\n\n", 2)[2])
    pictures.draw_all(OUTPUT)


def setup(app: Any) -> dict[str, Any]:
    app.connect("builder-inited", generate)
    return {"version": whitted.__version__, "parallel_read_safe": True}
