"""The README's snippet prints what the README says."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def test_snippet_prints_what_it_says(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    code = re.search(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)[1]
    printed = "\n".join(re.findall(r"# (.*)$", code, re.M))
    exec(compile(code, "README.md", "exec"), {})
    numbers = [
        [float(x) for x in re.findall(r"[-+.e\d]+", text)]
        for text in (printed, capsys.readouterr().out)
    ]
    # Printed with four digits; the last one may differ where sums are taken in another order
    assert numbers[1] == pytest.approx(numbers[0], rel=1e-3)
    assert len(numbers[0]) == 2


def test_two_commands_are_the_set_up():
    commands = re.findall(r"^    (\./setup.*)$", (ROOT / "README.md").read_text(), re.M)
    assert len(commands) == 2
    assert (ROOT / "setup").stat().st_mode & 0o111
