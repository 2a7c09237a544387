"""Fixtures that all tests share, and how Hypothesis looks for counterexamples."""

import os
from functools import cache

import pytest
from hypothesis import settings

import whitted  # noqa: F401  (chooses libLLVM before Dr.Jit is imported)
from whitted.scene.files import load_scene

# Random scenes in all; each of their six layouts, and any other property, has a sixth of them
SCENES = int(os.environ.get("WHITTED_RANDOM_SCENES", "300"))
# The same examples in every run; no deadline, as the first example compiles kernels
settings.register_profile(
    "whitted",
    derandomize=True,
    deadline=None,
    database=None,
    print_blob=True,
    max_examples=-(-SCENES // 6),
)
settings.load_profile("whitted")


@pytest.fixture
def load(tmp_path):
    """A function that loads a scene from the text of a scene file."""

    def load(text, precision="double"):
        path = tmp_path / "scene.toml"
        path.write_text(text)
        return load_scene(path, precision)

    return load


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    """As `load`, for tests with many examples: it keeps each scene that it has loaded."""
    path = tmp_path_factory.mktemp("scenes") / "scene.toml"

    @cache
    def load(text, precision="double"):
        path.write_text(text)
        return load_scene(path, precision)

    return load


@pytest.fixture(scope="module", params=["single", "double"])
def precision(request):
    """Both precisions."""
    return request.param
