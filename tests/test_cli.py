"""The command line, in a process of its own where signals or the start of Python matter."""

import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

import whitted as wt
from whitted import cli
from whitted.cli import run
from whitted.files.png import to_srgb

SCENES = Path(__file__).parent.parent / "scenes"
SCENE = SCENES / "cornell.toml"


def call(words, *arguments):
    """Run a command line of these words, then these arguments; returns the exit status."""
    return run([*words.split(), *map(str, arguments)])


def test_shipped_scene_is_rendered_by_its_name(tmp_path):
    for name, scene in (("a", SCENE), ("b", SCENE.stem)):
        path = tmp_path / f"{name}.exr"
        assert call("render --spp 4 --depth 3 --size 24x16", scene, "-o", path) == 0
    a, b = (wt.read_image(tmp_path / f"{name}.exr").numpy() for name in "ab")
    np.testing.assert_array_equal(a, b)


# What -o may name
KINDS = pytest.mark.parametrize("names", [("a.exr",), ("a.png",), ("b.png", "a.EXR")])


def outputs(folder, names):
    """The words of -o, once for each name."""
    return [word for name in names for word in ("-o", folder / name)]


@KINDS
def test_render_writes_what_is_named(tmp_path, capsys, names):
    command = "render --spp 4 --depth 3 --size 24x16"
    assert call(command, SCENE, *outputs(tmp_path, names)) == 0
    expected = wt.render(wt.load_scene(SCENE), 4, max_depth=3, resolution=(24, 16)).numpy()
    assert {path.name for path in tmp_path.iterdir()} == set(names)
    text = capsys.readouterr().out
    for name in names:
        assert str(tmp_path / name) in text
        # Of a PNG half a step of its 8 bits
        written, steps = wt.read_image(tmp_path / name).numpy(), name.endswith(".png")
        shown = to_srgb(written), to_srgb(expected)
        np.testing.assert_allclose(*shown, rtol=0, atol=0.51 / 255 if steps else 0)
        assert ("of its pixels clipped to [0, 1]" in text) == any(n.endswith(".png") for n in names)
    for part in (
        "24 x 16, spp 4, depth 3, single precision",
        "3 spheres, 5 planes",
        "operations",
        "compile",
        "run",
    ):
        assert part in text


def test_exr_header_tells_how_it_was_made(tmp_path):
    out = tmp_path / "a.exr"
    assert call("render --size 8x8 --precision double --no-boundary", SCENE, "-o", out) == 0
    with OpenEXR.File(str(out)) as file:
        header = file.header()
        assert header["whitted"] == wt.__version__
        assert header["sceneSHA256"] == hashlib.sha256(SCENE.read_bytes()).hexdigest()
        assert (header["spp"], header["maxDepth"], header["precision"]) == (1, 8, "double")
        assert header["renderSeconds"] > 0


def test_no_boundary_gives_plain_samples(tmp_path):
    plain, corrected = tmp_path / "plain.exr", tmp_path / "corrected.exr"
    assert call("render --size 24x16 --depth 3 --no-boundary", SCENE, "-o", plain) == 0
    assert call("render --size 24x16 --depth 3", SCENE, "-o", corrected) == 0
    expected = wt.render(
        wt.load_scene(SCENE), boundary=False, max_depth=3, resolution=(24, 16)
    ).numpy()
    np.testing.assert_array_equal(wt.read_image(plain).numpy(), expected)
    assert abs(wt.read_image(corrected).numpy() - expected).max() > 0.01


@pytest.mark.parametrize("scene", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_scenes_render(tmp_path, scene):
    assert call("render --size 16x16", scene, "-o", tmp_path / "a.exr") == 0
    image = wt.read_image(tmp_path / "a.exr").numpy()
    assert np.isfinite(image).all()
    # Neither black nor all of one colour
    assert image.std() > 0.01


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--spp", "3"], "--spp: expected a perfect square"),
        (["--spp", "x"], "'--spp'"),
        (
            ["--size", "0x4"],
            "--size: expected WIDTHxHEIGHT, as in 640x480, got '0x4'",
        ),
        (["--size", "4"], "--size: expected WIDTHxHEIGHT, as in 640x480, got '4'"),
        (
            ["--size", "1000000x1000000"],
            "--size: an image of 1000000 x 1000000 takes 11175.9 GiB, too much; use a smaller one",
        ),
        (["--depth", "0"], "--depth: expected a whole number from 1 to 256, got 0"),
        (["--precision", "half"], "'--precision'"),
        (["--sp", "4"], "No such option: --sp"),
    ],
)
def test_bad_arguments(tmp_path, capsys, arguments, message):
    for command in ("render", "gradient --wrt camera.fov"):
        assert call(command, SCENE, "-o", tmp_path / "a.exr", *arguments) == 2
        check_refusal(tmp_path, capsys, message)


def check_refusal(tmp_path, capsys, message):
    """One line on standard error, and nothing written."""
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not [p for p in tmp_path.iterdir() if p.suffix in (".exr", ".png") and p.is_file()]


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("a.jpg", "expected a file name that ends in .exr or .png"),
        ("none/a.exr", "make it first"),
        ("folder.exr", "is a folder; name a file"),
        ("preview.png", "preview.png: is a folder; name a file"),
        ("file/a.exr", "file' is a file; name a folder"),
        ("caf\udce9.exr", "OpenEXR takes only names in UTF-8"),
    ],
)
def test_bad_outputs(tmp_path, capsys, monkeypatch, output, message):
    """They are found before a scene is read."""
    monkeypatch.setattr(wt, "load_scene", None)
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "file").symlink_to(SCENE)
    (tmp_path / "preview.png").mkdir()
    for command in ("render", "gradient --wrt camera.fov"):
        assert call(command, SCENE, "-o", tmp_path / output) == 2
        check_refusal(tmp_path, capsys, message)


@pytest.mark.parametrize(
    ("name", "component", "terms"),
    [
        ("materials.glass.ior", None, "both"),
        ("spheres.ball.center", "y", "boundary"),
        ("lights.key.intensity", "z", "interior"),
    ],
)
def test_gradient_writes_exr_and_png(tmp_path, capsys, name, component, terms):
    out, colors, size = tmp_path / "a.exr", tmp_path / "colors.png", (24, 16)
    words = f"gradient --wrt {name} --spp 4 --depth 3 --size 24x16 --precision double"
    words += f" --terms {terms}" + (f" --component {component}" if component else "")
    assert call(words, SCENE, "-o", out, "-o", colors) == 0
    scene = wt.load_scene(SCENE, "double")
    expected = wt.gradient(
        scene, name, component, 4, terms=terms, max_depth=3, resolution=size
    ).numpy()
    written = wt.read_image(out).numpy()
    scale = abs(expected).max()
    assert scale > 0.01
    np.testing.assert_allclose(written, expected, atol=1e-6 * scale)
    check_colors(colors, written)
    text = capsys.readouterr().out
    printed = np.percentile(abs(written.mean(axis=-1)), 99.5)
    for part in (
        "24 x 16, spp 4, depth 3, double precision",
        "s compile",
        f"scale: {printed:.3g}, ",
        "0.52% of its pixels clipped",
    ):
        assert part in text
    with OpenEXR.File(str(out)) as file:
        header = file.header()
        assert header["wrt"] == (f"{name}.{component}" if component else name)
        assert header["terms"] == terms
        assert header["sceneSHA256"] == hashlib.sha256(SCENE.read_bytes()).hexdigest()


def check_colors(path, derivative):
    """Red where the derivative is clearly above 0, blue where it is clearly below, white at 0."""
    values = derivative.mean(axis=-1)
    height, width = values.shape
    with Image.open(path) as file:
        picture = np.asarray(file).astype(int)
    assert picture.shape[0] > height
    left = (picture.shape[1] - width) // 2
    red, _, blue = np.moveaxis(picture[:height, left : left + width], -1, 0)
    # An 8-bit colour differs from white beyond 1/255 of the scale; 5 % leaves a margin
    clear = 0.05 * np.percentile(abs(values), 99.5)
    for region, right in (
        (values > clear, red > blue),
        (values < -clear, red < blue),
        (values == 0, (red == 255) & (blue == 255)),
    ):
        assert right[region].all()
    assert (abs(values) > clear).any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--wrt", "ambient"],
            "--component: expected x, y or z (for red, green or blue of a colour) for the vector "
            "'ambient', got none",
        ),
        (
            ["--wrt", "camera.fov", "--component", "x"],
            "--component: expected none for the number 'camera.fov', got x",
        ),
        (
            ["--wrt", "spheres.bal.radius"],
            "the scene has no parameter 'spheres.bal.radius'; nearest: spheres.ball.radius, ",
        ),
        (["--wrt", "ambient", "--component", "w"], "--component: expected x, y or z"),
        (["--wrt", "camera.fov", "--terms", "none"], "'--terms'"),
        ([], "'--wrt'"),
    ],
)
def test_bad_gradients(tmp_path, capsys, arguments, message):
    out = tmp_path / "a.exr"
    assert call("gradient --size 8x8", SCENE, "-o", out, *arguments) == 2
    check_refusal(tmp_path, capsys, message)


@KINDS
def test_gradient_writes_what_is_named(tmp_path, capsys, names):
    command = "gradient --size 24x16 --depth 3 --wrt camera.fov"
    assert call(command, SCENE, *outputs(tmp_path, names)) == 0
    assert {path.name for path in tmp_path.iterdir()} == set(names)
    text = capsys.readouterr().out
    assert all(str(tmp_path / name) in text for name in names)
    assert ("scale: " in text) == any(name.endswith(".png") for name in names)


@pytest.mark.parametrize(
    ("names", "suffix"), [(["a.exr", "a.exr"], ".exr"), (["a.PNG", "a.exr", "b.png"], ".png")]
)
def test_two_outputs_of_a_kind(tmp_path, capsys, monkeypatch, names, suffix):
    monkeypatch.setattr(wt, "load_scene", None)
    alike = " and ".join(str(tmp_path / name) for name in names if name.lower().endswith(suffix))
    for command in ("render", "gradient --wrt camera.fov"):
        assert call(command, SCENE, *outputs(tmp_path, names)) == 2
        message = f"-o: {alike} end in {suffix}; name at most one .exr and one .png"
        check_refusal(tmp_path, capsys, message)


@pytest.mark.parametrize(
    ("options", "name"),
    [("--spp 1 --spp 4", "--spp"), ("--size 4x4 --depth 1 --size 4x4", "--size")],
)
def test_options_given_twice(tmp_path, capsys, options, name):
    for command in ("render", "gradient --wrt camera.fov"):
        assert call(f"{command} {options}", SCENE, "-o", tmp_path / "a.exr") == 2
        check_refusal(tmp_path, capsys, f"{name}: given more than once; give it once")


@pytest.mark.parametrize("name", ["a.exr", "a.png"])
def test_protected_files_stay(tmp_path, capsys, monkeypatch, name):
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK or path.name != name)
    monkeypatch.setattr(wt, "load_scene", None)
    (tmp_path / name).write_text("old")
    for command in ("render", "gradient --wrt camera.fov"):
        assert call(command, SCENE, *outputs(tmp_path, ["a.exr", "a.png"])) == 2
        assert f"{name}: is protected from being written" in capsys.readouterr().err
    assert (tmp_path / name).read_text() == "old"


def test_output_that_cannot_be_written(capsys):
    if not Path("/proc/self").is_dir():
        pytest.skip("needs a folder that nobody can write to")
    assert call("render --size 4x4 -o /proc/self/a.exr", SCENE) == 2
    message = "/proc/self/a.exr: the folder '/proc/self' cannot be written to; choose another"
    assert message in capsys.readouterr().err


def test_bad_scene_lists_every_problem(tmp_path, capsys):
    scene = tmp_path / "bad.toml"
    scene.write_text(SCENE.read_text().replace("fov ", "fovv ").replace("radius", "radios", 1))
    assert call("render", scene, "-o", tmp_path / "a.exr") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4
    assert all(line.startswith(f"{scene}: ") for line in lines)
    assert call("render", tmp_path / "none.toml", "-o", tmp_path / "a.exr") == 2
    check_refusal(tmp_path, capsys, "none.toml: cannot be read: No such file or directory")


def test_info_and_help(capsys):
    assert call("info") == 0
    text = capsys.readouterr().out
    for part in ("Dr.Jit:", "libLLVM:", "vector width:", "threads:", "kernel cache:"):
        assert part in text
    for command in ("render", "gradient", "params", "fit", "chart", "stress", "info"):
        assert call(f"{command} --help") == 0
        assert "Example" in capsys.readouterr().out
    assert call("rendr") == 2
    assert "Did you mean 'render'?" in capsys.readouterr().err


def cpu_seconds(pid):
    """The CPU time of a process: how far it is, whatever else the machine does."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def heed():
    """Accept Ctrl-C, which a process that a shell runs in the background ignores."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_interrupt_leaves_nothing(tmp_path):
    """Ctrl-C in a render that would take minutes: exit status 130, no file."""
    command = [sys.executable, "-m", "whitted.cli", "render", "--spp", "4096", str(SCENE)]
    process = subprocess.Popen(
        [*command, "-o", str(tmp_path / "a.exr")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=heed,
    )
    # Python has started and the render is under way, but far from done
    while cpu_seconds(process.pid) < 5:
        assert process.poll() is None
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    output, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b"Traceback" not in output + error
    assert list(tmp_path.iterdir()) == []


def test_interrupt_that_becomes_another_error(monkeypatch, capsys):
    """Dr.Jit may report the KeyboardInterrupt of a callback as an error of its own."""

    def fail(*_, **__):
        try:
            cli._interrupt(signal.SIGINT, None)
        except KeyboardInterrupt as error:
            raise RuntimeError("wrapped") from error

    monkeypatch.setattr(cli, "app", fail)
    monkeypatch.setattr(cli, "_interrupts", [])
    assert cli.run([]) == 130
    assert capsys.readouterr().err == ""


def test_without_llvm(tmp_path):
    """Without libLLVM: exit status 2, and one line that names it."""
    missing = str(tmp_path / "libLLVM.so")
    environment = {**os.environ, "DRJIT_LIBLLVM_PATH": missing}
    for words in ("render", "gradient --wrt camera.fov"):
        arguments = [*words.split(), str(SCENE), "-o", str(tmp_path / "a.exr")]
        process = subprocess.run(
            [sys.executable, "-m", "whitted.cli", *arguments],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert process.returncode == 2
        assert missing in process.stderr
        assert process.stderr.count("\n") == 1


def test_disk_that_is_full(tmp_path, capsys, monkeypatch):
    def fail(path, *_):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr("whitted.files.images.write_image", fail)
    assert call("render --size 4x4", SCENE, "-o", tmp_path / "a.exr") == 2
    check_refusal(tmp_path, capsys, "a.exr: cannot be read or written: No space left on device")


def test_error_chooses_the_samples(tmp_path, capsys, monkeypatch):
    from whitted.rendering.auto_samples import Setting

    offered = [Setting(4, False, 1.0), Setting(1, False, 2.0), Setting(4, True, 3.0)]
    monkeypatch.setattr("whitted.rendering.auto_samples.settings", lambda *_: offered)
    out = tmp_path / "a.exr"
    assert call("render --size 24x16 --depth 3 --error 0.5", SCENE, "-o", out) == 0
    assert "for an error of 0.5: spp 4, plain samples" in capsys.readouterr().out
    expected = wt.render(
        wt.load_scene(SCENE), 4, boundary=False, max_depth=3, resolution=(24, 16)
    ).numpy()
    np.testing.assert_array_equal(wt.read_image(out).numpy(), expected)
    assert call("render --size 24x16 --error 1e-9", SCENE, "-o", out) == 2
    assert "is below what is tried" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "names"),
    [
        ("--spp 1", "--spp"),
        ("--no-boundary", "--no-boundary"),
        ("--spp 4 --no-boundary", "--spp and --no-boundary"),
    ],
)
def test_error_excludes_what_it_chooses(tmp_path, capsys, options, names):
    assert call(f"render --error 0.5 {options}", SCENE, "-o", tmp_path / "a.exr") == 2
    message = f"--error: chooses {names} itself; leave {names} out, or --error"
    check_refusal(tmp_path, capsys, message)


def test_empty_scene(tmp_path, capsys):
    scene = tmp_path / "empty.toml"
    camera = "position = [0, 0, 4]\nlook_at = [0, 0, 0]\nfov = 50\nresolution = [4, 4]\n"
    scene.write_text(f"[camera]\n{camera}")
    assert call("render", scene, "-o", tmp_path / "a.exr") == 0
    assert "\ncompiled in: nothing; " in capsys.readouterr().out


def test_names_that_are_no_text(tmp_path):
    """A terminal takes text only."""
    scene = tmp_path / os.fsdecode(b"caf\xe9.toml")
    scene.write_bytes(SCENE.read_bytes())
    command = [sys.executable, "-m", "whitted.cli", "render", "--size", "4x4", scene]
    done = subprocess.run(
        [*command, "-o", tmp_path / "a.exr"],
        env={**os.environ, "PYTHONIOENCODING": "utf-8:strict"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert r"caf\udce9.toml: 4 x 4, spp 1" in done.stdout
