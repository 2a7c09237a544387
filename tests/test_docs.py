"""The documentation says what the code does."""

import inspect
import re
from pathlib import Path

import pytest

from whitted.scene import things

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


def test_architecture_has_every_room():
    text = (ROOT / "docs/architecture.md").read_text()
    rooms = {path.parent.name for path in ROOT.glob("whitted/*/__init__.py")}
    assert [room for room in sorted(rooms) if f"`{room}/`" not in text] == []
