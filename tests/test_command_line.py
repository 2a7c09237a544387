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


BAD = """[camera]
position = [0, 0, 3]
look_at = [0, 0, 0]
fov = 200
resolution = [8, 8]
[[spheres]]
center = [0, 0, 0]
radius = -1
material = "white"
"""
WRT = "--wrt camera.fov"
# Commands, and how many problems each tells. They run in a folder with bad.toml, which has three
# problems, and with text.exr and text.png, which are no images
REFUSED = {
    "render bad.toml -o a.png": 3,
    "render none.toml -o a.png": 1,
    "render text.png -o a.png": 1,
    "render cornell": 1,
    "render cornell -o a.jpg": 1,
    "render cornell -o a.png --spp 2": 1,
    "render cornell -o a.png --spp -1": 1,
    "render cornell -o a.png --depth 999": 1,
    "render cornell -o a.png --size 8": 1,
    "render cornell -o a.png --size -8x8": 1,
    "render cornell -o a.png --error 0": 1,
    "render cornell -o a.png --error 0.1 --spp 4": 1,
    f"gradient bad.toml -o a.png {WRT}": 3,
    "gradient cornell -o a.png --wrt camera.fog": 1,
    "gradient cornell -o a.png --wrt spheres.*.radius": 1,
    "gradient cornell -o a.png --wrt camera.position": 1,
    f"gradient cornell -o a.png {WRT} --component x": 1,
    f"gradient cornell -o a.png {WRT} --size 0x0": 1,
    "params bad.toml": 3,
    "params cornell camera.fog": 1,
    f"fit bad.toml text.png {WRT} -o out": 3,
    f"fit cornell none.png {WRT} -o out": 1,
    f"fit cornell text.exr {WRT} -o out": 1,
    f"fit cornell text.png {WRT} -o out": 1,
    f"fit cornell text.png {WRT} -o none/out": 1,
    "chart bad.toml -o out": 3,
    "chart cornell -o out --size 0x0": 1,
    "chart cornell -o none/out": 1,
    "stress no-such-case -o out": 1,
    "stress -o none/out": 1,
    "sweep cornell --vary camera.fov=40:50 -o a.zarr": 1,
    "sweep cornell --vary camera.fov=40:500 --count 2 -o a.zarr": 1,
    "sweep cornell --vary camera.fog=40:50 --count 2 -o a.zarr": 1,
    "sweep cornell --vary camera.fov=40:50 --count 2 -o none/a.zarr": 1,
    "sweep bad.toml --vary camera.fov=40:50 --count 2 -o a.zarr": 3,
    "render cornell -o a.zarr -o a.exr": 1,
    "draw cornell": 1,
}


@pytest.mark.parametrize("command", REFUSED)
def test_bad_input_is_refused(tmp_path, capfd, monkeypatch, command):
    """Status 2, one line for each problem, nothing on standard output, and nothing left behind."""
    monkeypatch.chdir(tmp_path)
    files = {"bad.toml": BAD, "text.exr": "no image", "text.png": "no image"}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    assert run(command.split()) == 2
    printed, error = capfd.readouterr()
    lines = error.splitlines()
    assert (printed, len(lines)) == ("", REFUSED[command])
    assert all(line.strip() and "Traceback" not in line for line in lines)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == files
