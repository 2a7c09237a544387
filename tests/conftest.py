"""Fixtures that all tests share."""

import pytest

import whitted  # noqa: F401  (chooses libLLVM before Dr.Jit is imported)
from whitted.scene.files import load_scene


@pytest.fixture
def load(tmp_path):
    """A function that loads a scene from the text of a scene file."""

    def load(text, precision="double"):
        path = tmp_path / "scene.toml"
        path.write_text(text)
        return load_scene(path, precision)

    return load


@pytest.fixture(params=["single", "double"])
def precision(request):
    """Both precisions."""
    return request.param
