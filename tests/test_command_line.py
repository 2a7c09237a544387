"""What belongs to no single command: versions, lists of parameters, completion by shells."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import whitted as wt
from whitted.cli import run

SCENES = Path(__file__).parent.parent / "scenes"
PROGRAM = Path(sys.executable).parent / "whitted"


def told(command, folder, **environment):
    """What a process prints that ends well and silently."""
    done = subprocess.run(
        [str(word) for word in command],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_version(capsys, tmp_path):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"whitted {wt.__version__}\n"
    as_module = [sys.executable, "-m", "whitted", "--version"]
    assert told(as_module, tmp_path) == f"whitted {wt.__version__}\n"


def test_params_lists_names_and_values(capsys):
    assert run(["params", "cornell"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    scene = wt.load_scene("cornell")
    assert [name for name, *_ in lines] == list(scene.parameters())
    values = {name: [float(number) for number in numbers] for name, *numbers in lines}
    again = scene.replace(values)
    for name, value in scene.parameters().items():
        assert again.parameters()[name].numpy().tolist() == value.numpy().tolist()


def test_params_of_a_pattern(capsys):
    assert run(["params", "cornell", "spheres.*.center"]) == 0
    assert capsys.readouterr().out == (
        "spheres.ball.center     0.17  -0.61  0.42\n"
        "spheres.mirror.center   -0.43  -0.44  -0.4\n"
        "spheres.diffuse.center  0.62  -0.65  -0.45\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["cornell", "spheres.bal.radius"], "no parameter 'spheres.bal.radius'; nearest: spheres."),
        (["cornell", "lamps.*"], "no parameter 'lamps.*'; nearest: "),
        (["cornel"], "cornel: there is no such file, and no shipped scene of this name; nearest: "),
        ([], "Missing argument 'scene'; see: whitted params --help"),
        (["cornell", "a", "b"], "unexpected extra argument(s) (b); see: whitted params --help"),
    ],
)
def test_params_refuses_bad_input(capsys, arguments, message):
    assert run(["params", *arguments]) == 2
    printed, error = capsys.readouterr()
    assert message in error
    assert (printed, error.count("\n")) == ("", 1)


def completed(folder, *words):
    """What bash is told about a line whose last word is being typed."""
    line = " ".join(("whitted", *words))
    place = {"COMP_WORDS": line, "COMP_CWORD": str(len(words))}
    return told([PROGRAM], folder, _WHITTED_COMPLETE="complete_bash", **place).split()


def test_completion(tmp_path):
    (tmp_path / "cornice.toml").touch()
    (tmp_path / "corner").mkdir()
    (tmp_path / "corn.txt").touch()
    shipped = [path.stem for path in sorted(SCENES.glob("corn*.toml"))]
    assert shipped
    assert completed(tmp_path, "render", "corn") == [*shipped, "corner", "cornice.toml"]
    # Where no shipped scene begins like this, bash looks for files itself
    assert completed(tmp_path, "render", "./corn") == []
    assert completed(tmp_path, "para") == ["params"]
    assert completed(tmp_path, "render", "--prec") == ["--precision"]
    assert completed(tmp_path, "render", "cornell", "--precision", "d") == ["double"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_script_of_completion(tmp_path, shell):
    script = told([PROGRAM], tmp_path, _WHITTED_COMPLETE=f"source_{shell}")
    assert f"_WHITTED_COMPLETE=complete_{shell}" in script


def test_completion_is_installed(tmp_path):
    """For the shell that runs the command."""
    script = f"{PROGRAM} --show-completion && {PROGRAM} --install-completion && echo done"
    output = told(["bash", "-c", script], tmp_path, HOME=str(tmp_path))
    assert "complete -o default -F _whitted_completion whitted" in output
    assert output.endswith("done\n")
    (installed,) = (tmp_path / ".bash_completions").iterdir()
    assert str(installed) in (tmp_path / ".bashrc").read_text()
