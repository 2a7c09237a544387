"""`whitted fit`: what it writes, and what it refuses."""

import re
import sys

import numpy as np
import OpenEXR
import pytest
from PIL import Image

import whitted as wt
from whitted.cli import run


def call(words, *arguments):
    """Run a command line of these words, then these arguments; returns the exit status."""
    return run([*words.split(), *map(str, arguments)])


RADIUS = "spheres.sphere0.radius"
FIT = f"fit --wrt {RADIUS} --spp 1 --iterations 4"
BALL = """
# a ball
background = [0.1, 0.2, 0.3]
ambient = [1, 1, 1]
max_depth = 1
[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
fov = 50
resolution = [24, 24]
[materials.red]
color = [0.8, 0.3, 0.1]
[[spheres]]
center = [0, 0, 0]
radius = 0.9   # a guess
material = "red"
"""


@pytest.fixture
def picture(tmp_path):
    """A scene file of a ball, and a picture of it with a slightly larger radius of 1."""
    path, target = tmp_path / "start.toml", tmp_path / "target.exr"
    path.write_text(BALL)
    wt.write_image(target, wt.render(wt.load_scene(path).replace({RADIUS: 1.0}), 16))
    return path, target


def test_fit_writes_what_it_found(picture, tmp_path, capsys):
    out = tmp_path / "out"
    assert call(FIT, *picture, "-o", out) == 0
    text = capsys.readouterr().out
    assert re.search(r"spheres\.sphere0\.radius +(1\.00|0\.99)\d* \+- ", text)
    names = {
        "scene.toml",
        "target.png",
        "start.png",
        "result.png",
        "difference.png",
        "convergence.png",
        "animation.gif",
    }
    assert {path.name for path in out.iterdir()} == names
    assert all(name in text for name in names)
    assert "# a guess" in (out / "scene.toml").read_text()
    radius = wt.load_scene(out / "scene.toml").parameters()[RADIUS].numpy()[0]
    assert radius == pytest.approx(1, abs=0.01)
    with Image.open(out / "animation.gif") as animation:
        assert animation.n_frames >= 2
        assert animation.size == (48, 24)


def test_fit_with_all_options(picture, tmp_path, capsys):
    mask = tmp_path / "mask.png"
    wt.write_image(mask, np.ones((24, 24, 3)))
    words = f"{FIT} --bound {RADIUS}=0.5:0.95 --gain --method adam --starts 2 --seed 1 --depth 1"
    words += " --size 24x24 --precision double --once"
    # The bound keeps it from the radius of the picture, 1
    assert call(words, *picture, "--mask", mask, "-o", tmp_path / "out") == 3
    text = capsys.readouterr().out
    assert "iterations" in text
    assert "quality: structured residual" in text


def test_fit_with_priors(picture, tmp_path):
    """Of two numbers: one is told more sharply than the picture, 1, tells; the other hardly."""
    known = f"--wrt spheres.sphere0.center --prior {RADIUS}=0.95:1e-6"
    known += " --prior spheres.sphere0.center=0,0,0:9,9,9"
    call(f"{FIT} {known} --once", *picture, "-o", tmp_path / "out")
    found = wt.load_scene(tmp_path / "out" / "scene.toml")
    assert float(found.parameters(RADIUS)[RADIUS][0]) == pytest.approx(0.95, abs=1e-4)


def test_fit_with_a_robust_loss(picture, tmp_path, capsys):
    """A corner of the picture shows something else, which the fit leaves out."""
    start, target = picture
    pixels = wt.read_image(target).numpy().copy()
    pixels[:3, :4] = 1
    wt.write_image(target, pixels)
    assert call(f"{FIT} --robust cauchy --budget 1", start, target, "-o", tmp_path / "out") == 0
    share = float(re.search(r"quality: explained, but for (\S+) of", capsys.readouterr().out)[1])
    # The corner, with a pixel around it; at 1 sample pixels on the edge may go as well
    assert 4 * 5 / 24**2 <= share + 5e-4 < 0.25


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            f"--wrt {RADIUS} --size 8x8",
            "target.exr: has 24x24 pixels, and the fit 8x8; give --size",
        ),
        (f"--wrt {RADIUS} --size 0x8", "--size: expected WIDTHxHEIGHT"),
        (f"--wrt {RADIUS} --iterations 0", "--iterations: expected a whole number from 1 on"),
        (f"--wrt {RADIUS} --spp 3", "--spp: expected a perfect square"),
        (f"--wrt {RADIUS} --size big", "--size: expected WIDTHxHEIGHT"),
        ("--wrt spheres.ball.radius", "no parameter 'spheres.ball.radius'"),
        (f"--wrt {RADIUS} --bound {RADIUS}", "--bound: expected NAME=LOW:HIGH"),
        (
            f"--wrt {RADIUS} --bound {RADIUS}=0.5: --bound {RADIUS}=:2",
            f"--bound: given twice for {RADIUS}; give both ends in one, LOW:HIGH",
        ),
        (f"--wrt {RADIUS} --bound {RADIUS}=1:2", "starts at 0.9, outside [1, 2]"),
        (f"--wrt {RADIUS} --bound camera.fov=1:2", "--bound: 'camera.fov' is not among the"),
        (f"--wrt {RADIUS} --prior {RADIUS}=1", "--prior: expected NAME=MEAN:SIGMA, as in"),
        (
            f"--wrt {RADIUS} --prior {RADIUS}=1:x",
            f"SIGMA, as in materials.glass.ior=1.5:0.01, got '{RADIUS}=1:x'",
        ),
        (
            f"--wrt {RADIUS} --prior {RADIUS}=1:2 --prior {RADIUS}=1:1",
            f"--prior: given twice for {RADIUS}; give it once",
        ),
        (f"--wrt {RADIUS} --prior {RADIUS}=1:0", f"--prior: {RADIUS}: expected a sigma > 0"),
        (f"--wrt {RADIUS} --prior camera.fov=1:1", "--prior: 'camera.fov' is not among the"),
        (f"--wrt {RADIUS} --starts 2 --seed -1", "--seed: expected a whole number from 0 on"),
        (f"--wrt {RADIUS} --budget 0", "--budget: expected a number of seconds > 0"),
        (
            f"--wrt {RADIUS} --once --budget 9",
            "--budget: there are no further tries with --once; leave out one of both",
        ),
        (f"--wrt {RADIUS} --wrt {RADIUS}", f"--wrt: '{RADIUS}' is named twice"),
        (f"--wrt {RADIUS} --starts 2 --starts 3", "--starts: given more than once; give it once"),
        (f"--wrt {RADIUS} --method newton", "'--method'"),
        (f"--wrt {RADIUS} --robust l1", "'--robust'"),
        (f"--wrt {RADIUS} --robust huber --gain", "--robust: not with gain=True"),
        ("--wrt materials.red.ior --iterations 1 --once", "depends on none of the parameters"),
    ],
)
def test_fit_refuses_bad_input(picture, tmp_path, capsys, options, message):
    assert call(f"fit {options}", *picture, "-o", tmp_path / "out") == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("role", ["scene", "target", "mask"])
def test_fit_does_not_write_over_its_input(picture, tmp_path, capsys, monkeypatch, role):
    """Where a folder of results holds one of the files that are read."""
    monkeypatch.setattr(wt, "load_scene", None)
    out = tmp_path / "out"
    out.mkdir()
    own = out / {"scene": "scene.toml", "target": "target.png", "mask": "start.png"}[role]
    own.write_bytes(b"old")
    files = {**dict(zip(("scene", "target"), picture, strict=True)), "mask": picture[1], role: own}
    words = f"{FIT} --mask {files['mask']}"
    assert call(words, files["scene"], files["target"], "-o", f"{out}/../out") == 2
    assert capsys.readouterr().err == (f"{own}: would be written over; name another folder by -o\n")
    assert [(path, path.read_bytes()) for path in out.iterdir()] == [(own, b"old")]


def test_fit_refuses_folders_that_it_cannot_write(picture, capsys):
    for out, message in (
        ("/no/such/folder", "there is no folder"),
        (picture[0], "is a file; name a folder"),
    ):
        assert call(FIT, *picture, "-o", out) == 2
        assert message in capsys.readouterr().err


@pytest.mark.parametrize("name", ["scene.toml", "target.png", "animation.gif"])
def test_fit_finds_files_that_it_cannot_write_before_it_starts(
    picture, tmp_path, capsys, monkeypatch, name
):
    monkeypatch.setattr(wt, "fit", None)
    (tmp_path / "out" / name).mkdir(parents=True)
    assert call(FIT, *picture, "-o", tmp_path / "out") == 2
    assert f"{name}: is a folder; name a file" in capsys.readouterr().err


def test_fit_needs_its_extra(picture, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert call(FIT, *picture, "-o", tmp_path / "out") == 2
    assert "pip install 'whitted[fit]'" in capsys.readouterr().err


def test_fit_to_a_layer(picture, tmp_path, capsys):
    """Of an EXR with several layers the target is named by --layer; else they are listed."""
    start, target = picture
    pixels = wt.read_image(target).numpy()
    layered = tmp_path / "layered.exr"
    names = {
        f"{layer}.{c}": pixels[..., k].copy()
        for layer in ("fog", "ball")
        for k, c in enumerate("RGB")
    }
    OpenEXR.File({}, names).write(str(layered))
    assert call(FIT, start, layered, "-o", tmp_path / "out") == 2
    assert capsys.readouterr().err == (
        f"{layered}: there are several layers; name one by layer= or --layer: ball, fog\n"
    )
    assert call(f"{FIT} --layer mist", start, layered, "-o", tmp_path / "out") == 2
    assert "there is no layer 'mist'; its layers are: ball, fog" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert call(f"{FIT} --layer ball", start, layered, "-o", tmp_path / "out") == 0
