"""The stairs of the house: a room imports only from those below it, and no modules import each
other in a circle.

The rule is in pyproject.toml, and import-linter checks it.
"""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def linted(folder):
    """Exit status and output of import-linter for the package in a folder."""
    command = [str(Path(sys.executable).parent / "lint-imports"), "--no-logo", "--no-cache"]
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    return done.returncode, done.stdout


def test_rooms_are_in_order():
    status, told = linted(ROOT)
    assert status == 0, told


@pytest.mark.parametrize(
    ("module", "line", "broken"),
    [
        ("tracing/media.py", "from ..edges import labels", "rooms BROKEN"),
        ("core/ray.py", "from . import frozen", None),
        ("core/arrays.py", "from . import frozen", "no circles within rooms BROKEN"),
        ("other.py", "", "rooms BROKEN"),
    ],
)
def test_an_import_upstairs_is_noticed(tmp_path, module, line, broken):
    shutil.copytree(ROOT / "whitted", tmp_path / "whitted")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    with (tmp_path / "whitted" / module).open("a") as file:
        file.write(f"\n{line}\n")
    status, told = linted(tmp_path)
    assert status == (1 if broken else 0), told
    assert broken is None or broken in told


def test_only_standard_library_before_drjit():
    """`llvm` chooses the library that Dr.Jit loads, so that it imports Dr.Jit only inside a
    function.
    """
    tree = ast.parse((ROOT / "whitted" / "llvm.py").read_text())
    top = [node for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom))]
    names = {alias.name for node in top for alias in node.names}
    names |= {getattr(node, "module", None) for node in top}
    outside = ("drjit", "numpy", "whitted")
    assert not {name for name in names if name and name.split(".")[0] in outside}
