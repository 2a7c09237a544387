"""The documentation says what the code does."""

import importlib
import inspect
import re
from pathlib import Path

import pytest

import whitted as wt
from whitted import cluster
from whitted.lights import LIGHTS
from whitted.scene import things
from whitted.scene.tables import GROUPS
from whitted.shapes import SHAPES

ROOT = Path(__file__).parents[1]
PAGES = [*sorted(ROOT.glob("docs/*.md")), *sorted(ROOT.glob("*.md")), ROOT / "results/peers.md"]


@pytest.mark.parametrize("file", ["shapes/disc.py", "lights/directional.py"])
def test_the_example_of_a_page_is_the_file(file):
    text = (ROOT / "docs/extending.md").read_text()
    assert f"```python\n{(ROOT / 'whitted' / file).read_text()}```" in text


def test_the_constructor_of_a_page_is_the_code():
    text = (ROOT / "docs/extending.md").read_text()
    assert f"```python\n{inspect.getsource(things.Disc)}```" in text


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page):
    targets = re.findall(r"\]\(([^)#]+)", page.read_text())
    local = [target for target in targets if "://" not in target]
    assert [target for target in local if not (page.parent / target).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_are_named_exist(page):
    """Names such as `tracing/node.py` are of the package; whole paths are of the project."""
    named = re.findall(r"`([\w./]+\.py|[\w./]+/)`", page.read_text())
    places = ROOT, ROOT / "whitted", ROOT / "whitted/tracing"
    missing = [name for name in named if not any((place / name).exists() for place in places)]
    assert missing == []


def test_examples_of_the_scene_format_are_one_scene():
    text = (ROOT / "docs/scene_format.md").read_text()
    scene = wt.parse_scene("\n".join(re.findall(r"```toml\n(.*?)```", text, re.S)))
    kinds = {type(thing).__name__ for thing in (*scene.shapes, *scene.lights)}
    assert kinds == {kind.__name__ for kind in (*SHAPES, *LIGHTS.values())}


def test_scene_format_has_the_keys_of_every_table():
    text = (ROOT / "docs/scene_format.md").read_text()
    names = {"scene", "camera", "materials", "checker", *GROUPS, *LIGHTS}
    assert sorted(re.findall(r"<!-- keys-(\w+): ", text)) == sorted(names)


@pytest.mark.parametrize("page", ["scene_format", "mitsuba", "command_line"])
def test_tables_of_the_code_are_up_to_date(page, monkeypatch):
    """If not: .venv/bin/python docs/generate.py"""
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    generate = importlib.import_module("generate")
    text = (ROOT / f"docs/{page}.md").read_text()
    assert generate.refreshed(text) == text
    assert generate.refreshed(text.replace("|", "")) == text


def test_tutorial_shows_what_readers_look_for():
    text = (ROOT / "docs/tutorial.md").read_text()
    cells = "\n".join(re.findall(r"```\{code-cell\}\n(.*?)```", text, re.S))
    for call in ("truth.add(", ".remove(", '"max_depth": ', ".material", "Adam(", ".step()"):
        assert call in cells
    for words in ("wt.show(", "`--size 640x480`", "torch_render"):
        assert words in text


def test_reference_has_every_public_name():
    text = (ROOT / "docs/api.md").read_text()
    listed = re.findall(r"\.\. auto\w+:: ([\w.]+)", text)
    own = "whitted.cluster."
    names = [name for name in listed if not name.startswith(own)]
    assert sorted([*names, "__version__"]) == sorted(wt.__all__)
    assert sorted(f"{own}{name}" for name in cluster.__all__) == sorted({*listed} - {*names})


def test_every_page_is_in_the_contents():
    text = (ROOT / "docs/index.md").read_text()
    contents = " ".join(re.findall(r"```\{toctree\}\n(.*?)```", text, re.S)).split()
    pages = {page.stem for page in ROOT.glob("docs/*.md")} - {"index"}
    assert pages <= set(contents)
    # A code host shows links, and no contents
    assert pages == set(re.findall(r"^- \[.*\]\((\w+)\.md\): ", text, re.M))


def test_architecture_has_every_room():
    text = (ROOT / "docs/architecture.md").read_text()
    rooms = {path.parent.name for path in ROOT.glob("whitted/*/__init__.py")}
    assert [room for room in sorted(rooms) if f"`{room}/`" not in text] == []
