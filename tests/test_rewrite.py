"""Scene files with new numbers: all else stays, and the file reads back as the same scene."""

import sys

import numpy as np
import pytest
from hypothesis import given
from random_scenes import LAYOUTS
from samples import EPSILON, SHIPPED
from strategies import scenes

from whitted.scene.files import load_scene
from whitted.scene.rewrite import rewritten

TEXT = """# a scene
background = [0.1, 0.2, 0.3]   # dusk

[camera]
position = [0, 0, 4]
look_at = [0, 0, 0]
fov = 50   # vertical
resolution = [8, 8]

[materials."lead glass"]
ior = 1.6          # a guess
color = [0, 0, 0]

[[spheres]]
center = [0, 0, 0]     # in the middle
radius = 1
material = "lead glass"

[[spheres]]
name = "b.c"
center = [2, 0, 0]
radius = 0.5
material = "lead glass"

[[planes]]
normal = [0, 1, 0]
offset = 1
material = "lead glass"

[[lights]]
name = "key"
position = [1, 2, 3]
intensity = [1, 1, 1]
"""
VALUES = {
    "background": [0.4, 0.5, 0.6],
    "ambient": [0.01, 0.02, 0.03],
    "camera.fov": 41.5,
    "materials.lead glass.ior": 1.7123456789,
    "materials.lead glass.specular": 0.25,
    "spheres.sphere0.center": [1.0, 2.0, 3.0],
    "spheres.b.c.radius": 0.75,
    "planes.plane0.normal": [0.0, 0.6, 0.8],
    "lights.key.intensity": [0.5, 0.25, 0.125],
}


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(TEXT)
    return path


def test_new_numbers_are_read_back(path):
    text = rewritten(path, VALUES)
    path.write_text(text)
    found = load_scene(path, "double").parameters(*VALUES)
    for name, value in VALUES.items():
        # Half a unit of the ninth digit
        np.testing.assert_allclose(found[name].numpy().ravel(), np.ravel(value), rtol=5e-9)


def test_all_else_stays(path):
    lines, changed = (
        TEXT.splitlines(),
        rewritten(path, {"materials.lead glass.ior": 1.75, "spheres.sphere0.center": [1, 2, 3]}),
    )
    differing = [
        pair for pair in zip(lines, changed.splitlines(), strict=True) if pair[0] != pair[1]
    ]
    assert [new for _, new in differing] == [
        "ior = 1.75          # a guess",
        "center = [1.0, 2.0, 3.0]     # in the middle",
    ]
    assert rewritten(path, {}) == TEXT


def numbers_of(scene):
    return {name: value.numpy().ravel() for name, value in scene.parameters().items()}


def check_same_numbers(again, numbers):
    """Nine digits are all that single precision has. A direction is made unit again, which may
    round another way.
    """
    assert list(again) == list(numbers)
    for name, value in numbers.items():
        if name.endswith(("normal", "direction")):
            np.testing.assert_allclose(again[name], value, rtol=0, atol=EPSILON["single"] / 2)
        else:
            np.testing.assert_array_equal(again[name], value, name)


@pytest.mark.parametrize("file", SHIPPED, ids=lambda path: path.stem)
def test_shipped_scene_is_read_back_as_it_was(tmp_path, file):
    numbers = numbers_of(load_scene(file))
    (tmp_path / "a.toml").write_text(rewritten(file, numbers))
    check_same_numbers(numbers_of(load_scene(tmp_path / "a.toml")), numbers)


@given(scenes(LAYOUTS["mixed"], generic=False))
def test_any_scene_is_read_back_as_it_was(tmp_path_factory, numbers):
    """Written by a test, read, written with the numbers that were read, and read again."""
    path = tmp_path_factory.mktemp("rewrite") / "a.toml"
    path.write_text(LAYOUTS["mixed"].text(numbers))
    first = numbers_of(load_scene(path))
    for name, value in numbers.items():
        np.testing.assert_allclose(first[name], np.ravel(value), rtol=EPSILON["single"] / 2)
    path.write_text(rewritten(path, first))
    check_same_numbers(numbers_of(load_scene(path)), first)


def test_byte_order_mark_is_left_out(path):
    text = rewritten(path, VALUES)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert rewritten(path, VALUES) == text


def test_without_tomlkit_the_remedy_is_told(path, monkeypatch):
    monkeypatch.setitem(sys.modules, "tomlkit", None)
    with pytest.raises(RuntimeError, match=r"install it with: pip install 'whitted\[fit\]'"):
        rewritten(path, {})
