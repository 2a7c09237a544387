"""Images on screens: encoded, shown by a viewer or by a notebook."""

import io
import sys
import time
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import samples
from drjit.llvm import ad
from PIL import Image

import whitted as wt
from whitted.files import display, viewer

PIXELS = np.array([[[0, 0.5, 1], [-1, 2, np.nan]], [[0.002, 0.2, 0.9], [1, 1, 0]]])
# By the formula of IEC 61966-2-1; NaN is black
SRGB = [[[0, 188, 255], [0, 255, 0]], [[7, 124, 243], [255, 255, 0]]]


def tensor(pixels=PIXELS):
    return ad.TensorXf(pixels.astype(np.float32))


def decoded(data):
    return np.asarray(Image.open(io.BytesIO(data))).tolist()


class Notebook:
    """An IPython with a kernel, as far as it matters."""

    def __init__(self, monkeypatch):
        self.shown, self.formats = [], {}
        shell = SimpleNamespace(kernel=None, display_formatter=self, formatters={"image/png": self})
        ipython, inner = ModuleType("IPython"), ModuleType("IPython.display")
        ipython.get_ipython = lambda: shell
        inner.display = self.shown.append
        inner.Image = lambda data, format: (format, data)
        monkeypatch.setitem(sys.modules, "IPython", ipython)
        monkeypatch.setitem(sys.modules, "IPython.display", inner)
        self.formatters = shell.formatters

    def for_type(self, kind, function):
        self.formats[kind] = function


@pytest.mark.parametrize(
    "image", [PIXELS, tensor(), PIXELS.tolist()], ids=["NumPy", "Dr.Jit", "list"]
)
def test_to_srgb_encodes_in_8_bits(image):
    encoded = wt.to_srgb(image)
    assert encoded.dtype == np.uint8
    assert encoded.tolist() == SRGB


def test_other_shapes_are_refused():
    with pytest.raises(
        ValueError, match=r"^image: expected an image of shape \(height, width, 3\), got \(2, 2\)$"
    ):
        wt.to_srgb(PIXELS[..., 0])
    with pytest.raises(ValueError, match=r"^image: expected an image of shape"):
        wt.show(PIXELS[..., 0])


@pytest.fixture
def program(monkeypatch, tmp_path):
    """Makes a program that is the only viewer; it leaves its picture as `seen`."""
    folder = tmp_path / "bin"
    folder.mkdir()
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    monkeypatch.setattr(viewer, "COMMANDS", ((str(folder / "viewer"),),))
    monkeypatch.setattr(viewer, "KEPT", 0.0)

    def make(script):
        path = folder / "viewer"
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        return temporary

    return make


def left_in(folder):
    """What is in a folder, as soon as that is nothing."""
    until = time.monotonic() + 20
    while time.monotonic() < until and any(folder.iterdir()):
        time.sleep(0.01)
    return list(folder.iterdir())


def test_show_opens_the_viewer_of_the_system(program, capfd, tmp_path):
    folder = program(f'cp "$1" {tmp_path}/seen.png')
    wt.show(tensor())
    assert np.asarray(Image.open(tmp_path / "seen.png")).tolist() == SRGB
    assert capfd.readouterr() == ("", "")
    assert left_in(folder) == []


def test_a_viewer_that_stays_open_has_shown_the_picture(program, capfd, monkeypatch):
    monkeypatch.setattr(viewer, "PATIENCE", 0.01)
    folder = program("sleep 1")
    wt.show(tensor())
    assert capfd.readouterr() == ("", "")
    assert left_in(folder) == []


@pytest.mark.parametrize("commands", [(), None], ids=["no program", "none that it finds"])
def test_show_writes_a_file_where_there_is_no_viewer(program, capfd, monkeypatch, commands):
    folder = program("echo no application knows this file >&2; exit 3")
    if commands is not None:
        monkeypatch.setattr(viewer, "COMMANDS", commands)
    wt.show(tensor())
    (path,) = folder.glob("*/image.png")
    assert np.asarray(Image.open(path)).tolist() == SRGB
    told = f"there is no program that shows pictures; wrote {path}\n"
    assert capfd.readouterr() == (told, "")


def test_show_takes_a_scene(program, tmp_path):
    folder = program(f'cp "$1" {tmp_path}/seen.png')
    scene = wt.load_scene("three_diffuse")
    wt.show(scene)
    assert (tmp_path / "seen.png").read_bytes() == scene._repr_png_()
    assert left_in(folder) == []


def test_show_shows_below_the_cell_of_a_notebook(monkeypatch):
    notebook = Notebook(monkeypatch)
    wt.show(tensor())
    ((kind, data),) = notebook.shown
    assert (kind, decoded(data)) == ("png", SRGB)


def test_a_notebook_shows_images_as_pictures(monkeypatch):
    notebook = Notebook(monkeypatch)
    display.show_tensors_in_notebooks()
    as_png = notebook.formats[ad.TensorXf]
    assert notebook.formats[ad.TensorXf64] is as_png
    assert decoded(as_png(tensor())) == SRGB
    # Others are shown as text
    assert as_png(tensor(PIXELS[..., 0])) is as_png(tensor(PIXELS[..., :2])) is None


def test_no_notebook_is_no_trouble(monkeypatch):
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: None))
    display.show_tensors_in_notebooks()
    assert display.notebook() is None


@pytest.mark.parametrize(
    ("resolution", "size"), [((16, 12), (16, 12)), ((1024, 512), (256, 128)), ((1, 1000), (1, 256))]
)
def test_a_scene_shows_a_small_picture(resolution, size):
    scene = wt.parse_scene(
        samples.keys(background=[1, 0.2, 0]) + samples.camera([0, 0, 3], resolution=resolution)
    )
    image = Image.open(io.BytesIO(scene._repr_png_()))
    assert image.size == size
    assert image.getpixel((0, 0)) == (255, 124, 0)
