"""The stairs of the house: each module imports only from those before it."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "whitted"
ORDER = [
    *("llvm", "geometry", "optics", "camera", "scene", "schema", "scene_file", "surface", "shading"),
    *("decisions", "stack", "trace", "chain", "events", "derivative", "film", "crossing", "quadrature"),
    *(
        "frozen",
        "wavefront",
        "probe",
        "edges",
        "region",
        "correction",
        "boundary",
        "render",
        "image",
        "accuracy",
        "bridge",
        "gradient",
        "diverging",
        "convergence",
        "ranges",
        "objective",
        "fit",
        "rewrite",
        "recovery",
        "timing",
        "about",
        "measure",
        "experiments",
        "chart",
        "hard_case",
        "hard_scene",
        "hard_rays",
        "hard_optics",
        "hard_paths",
        "hard_images",
        "hard_edges",
        "hard_input",
        "stress",
        "stress_report",
        "cli",
    ),
]


def imported(source):
    """The modules of the package that a module's source imports."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[1] for alias in node.names if alias.name.startswith("whitted.")}
            found |= {"__init__" for alias in node.names if alias.name == "whitted"}
        elif isinstance(node, ast.ImportFrom):
            module = (node.module or "").split(".")
            if node.level == 0 and module[0] == "whitted":
                module = module[1:]
            elif node.level == 0:
                continue
            # `from . import llvm` names modules, or what the package itself defines
            names = {alias.name if (PACKAGE / f"{alias.name}.py").exists() else "__init__" for alias in node.names}
            found |= {module[0]} if module and module[0] else names
    return found


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("import whitted", {"__init__"}),
        ("import whitted.trace as t", {"trace"}),
        ("from . import wavefront, __version__", {"wavefront", "__init__"}),
        ("def f():\n    from .scene import Scene", {"scene"}),
        ("from whitted.film import band", {"film"}),
        ("from whitted import film", {"film"}),
        ("import drjit\nfrom drjit.llvm import ad", set()),
    ],
)
def test_imports_are_seen(source, expected):
    assert imported(source) == expected


def test_every_module_has_its_place():
    assert sorted(path.stem for path in PACKAGE.glob("*.py")) == sorted([*ORDER, "__init__"])
    assert [path for path in PACKAGE.rglob("*.py") if path.parent != PACKAGE] == []


@pytest.mark.parametrize("module", ORDER)
def test_module_imports_from_those_before_it(module):
    before = ORDER[: ORDER.index(module)]
    # The package's own names, such as its version, are for the top of the stairs
    allowed = {*before, "__init__"} if module == "cli" else set(before)
    assert imported((PACKAGE / f"{module}.py").read_text()) <= allowed


def test_only_standard_library_before_drjit():
    """`llvm` chooses the library that Dr.Jit loads, so that it may import it only inside a function."""
    tree = ast.parse((PACKAGE / "llvm.py").read_text())
    top = [node for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom))]
    names = {alias.name for node in top for alias in node.names} | {getattr(node, "module", None) for node in top}
    assert not {name for name in names if name and name.split(".")[0] in ("drjit", "numpy", "whitted")}
