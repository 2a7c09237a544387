"""Damaged files are read or refused: a few hundred of them here, and as many as one likes by
`benchmarks/fuzz.py`.
"""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import fuzz


@pytest.mark.filterwarnings("ignore")  # Pillow's, of files that it reads all the same
@pytest.mark.parametrize("first", [1, 101, 201, 301])
def test_damaged_files_are_read_or_refused(tmp_path, first, capfd):
    seen = set()
    for number in range(first, first + 100):
        kind, data = fuzz.make(1, number)
        path = tmp_path / f"a.{kind}"
        path.write_bytes(data)
        result = fuzz.outcome(path)
        assert result in ("read", "SceneError", "ValueError"), (number, result)
        assert path.read_bytes() == data
        seen.add((kind, result))
    assert len(list(tmp_path.iterdir())) == 3
    # Both outcomes of each kind of file
    assert len(seen) == 6


@pytest.mark.parametrize("number", [0, 3, 4, 5, 9, 10, 12])
def test_large_or_empty_scene_files_are_refused(tmp_path, number):
    path = tmp_path / "a.toml"
    path.write_bytes(fuzz.LARGE_SCENES[number]())
    assert fuzz.outcome(path) == "SceneError"


def test_failure_and_slowness_are_reported(tmp_path, capsys):
    found = [
        ("1.exr", 0.1, "ValueError"),
        ("2.png", 0.1, "FAILURE: IndexError: of"),
        ("3.toml", 99.0, "SceneError"),
    ]
    assert fuzz.report(iter(found), tmp_path) == 1
    text = capsys.readouterr().out
    assert "2.png: FAILURE: IndexError: of (0.1 s)" in text
    assert "3.toml: SceneError (99.0 s)" in text
    assert "failures: 2" in text


def test_input_that_ends_the_process_is_reported(tmp_path, monkeypatch):
    """The batch goes on with the next input."""
    runs = iter([["0 0.toml 0.100 SceneError", "1 1.exr "], ["2 2.toml 0.100 read"]])
    monkeypatch.setattr(fuzz, "_lines", lambda *_: iter(next(runs)))
    expected = [
        ("0.toml", 0.1, "SceneError"),
        ("1.exr", fuzz.SECONDS, "FAILURE: the process ended"),
        ("2.toml", 0.1, "read"),
    ]
    assert list(fuzz.results(0, 3, tmp_path)) == expected
