"""The README's snippet prints what the README says."""

import re
from pathlib import Path

ROOT = Path(__file__).parent.parent


def test_snippet_prints_what_it_says(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    code = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)[1]
    says = re.findall(r"# (.*)$", code, re.M)
    exec(compile(code, "README.md", "exec"), {})
    # Only digits that hold whatever the width of the vectors, by which sums are taken in another
    # order: the gradient differs by 0.1 %
    assert capsys.readouterr().out.splitlines() == says
    assert len(says) == 2


def test_two_commands_are_the_set_up():
    commands = re.findall(r"^    (\./setup.*)$", (ROOT / "README.md").read_text(), re.M)
    assert len(commands) == 2
    assert (ROOT / "setup").stat().st_mode & 0o111
