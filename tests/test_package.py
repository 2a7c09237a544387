"""What describes the package agrees: its version, its licence, and the tools of its hooks."""

import re
from pathlib import Path

import pytest
import tomlkit

import whitted as wt

ROOT = Path(__file__).parents[1]


def text(name):
    return (ROOT / name).read_text()


PROJECT = tomlkit.parse(text("pyproject.toml")).unwrap()


def test_version_is_the_newest_of_the_changes():
    assert re.search(r"^## (.*)$", text("CHANGELOG.md"), re.M)[1] == wt.__version__


def test_version_is_the_one_that_is_cited():
    assert f"\nversion: {wt.__version__}\n" in text("CITATION.cff")


@pytest.mark.parametrize("name", ["pyproject.toml", "CITATION.cff"])
def test_licence_is_that_of_the_file(name):
    assert "BSD-3-Clause" in text(name)
    assert text("LICENSE").startswith("BSD 3-Clause License")


@pytest.mark.parametrize("tool", ["ruff", "mypy", "import-linter"])
def test_tools_of_the_hooks_are_pinned(tool):
    extra = PROJECT["project"]["optional-dependencies"]["test"]
    assert [one for one in extra if re.fullmatch(rf"{tool}==[\d.]+", one)]


def test_hooks_use_tools_that_are_installed():
    entries = re.findall(r"entry: (\S+)", text(".pre-commit-config.yaml"))
    assert [Path(entry).name for entry in entries] == ["ruff", "ruff", "lint-imports", "mypy"]
    assert {str(Path(entry).parent) for entry in entries} == {".venv/bin"}


def test_page_on_an_index_has_no_relative_address():
    """Pictures and links whose addresses are relative are broken there."""
    hook = PROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]
    page = text("README.md")
    for rule in hook["substitutions"]:
        page = re.sub(rule["pattern"], rule["replacement"], page)
    addresses = re.findall(r"\]\(([^)]*)\)", page)
    assert addresses
    assert all(address.startswith("https://") for address in addresses)
