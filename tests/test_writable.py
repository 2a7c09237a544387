"""A file that cannot be written is refused before time goes into its contents.

Root may write everywhere, so that some tests say themselves what may be written.
"""

import os

import numpy as np
import pytest

from whitted.files.atomic import write_text
from whitted.files.images import check_image, write_image
from whitted.files.writable import check_file, check_folder


@pytest.fixture
def protect(monkeypatch):
    """A function that protects one path from being written."""
    access = os.access

    def protect(protected):
        monkeypatch.setattr(
            os, "access", lambda path, mode: path != protected and access(path, mode)
        )

    return protect


def test_what_can_be_written(tmp_path):
    (tmp_path / "old").touch()
    (tmp_path / "link").symlink_to("nowhere")
    for name in ("new", "old", "link"):
        check_file(tmp_path / name)
    for folder in (tmp_path, tmp_path / "new"):
        check_folder(folder, ["new", "old", "link"])
    assert sorted(os.listdir(tmp_path)) == ["link", "old"]


def test_folders_in_the_way(tmp_path):
    (tmp_path / "folder").mkdir()
    with pytest.raises(ValueError, match="folder: is a folder; name a file"):
        check_file(tmp_path / "folder")
    with pytest.raises(ValueError, match="folder: is a folder; name a file"):
        check_folder(tmp_path, ["new", "folder"])


def test_files_in_the_way(tmp_path):
    (tmp_path / "file").touch()
    for check in (check_file, lambda path: check_folder(path, [])):
        with pytest.raises(ValueError, match=r"file/new: '.*file' is a file; name a folder"):
            check(tmp_path / "file" / "new")
    with pytest.raises(ValueError, match="file: is a file; name a folder"):
        check_folder(tmp_path / "file", [])


def test_missing_folders(tmp_path):
    for check in (check_file, lambda path: check_folder(path, [])):
        with pytest.raises(ValueError, match=r"there is no folder '.*none'; make it first"):
            check(tmp_path / "none" / "new")


def test_protected_folders(tmp_path, protect):
    protect(tmp_path)
    with pytest.raises(
        ValueError, match=r"new: the folder '.*' cannot be written to; choose another"
    ):
        check_file(tmp_path / "new")
    for folder in (tmp_path, tmp_path / "new"):
        with pytest.raises(ValueError, match="cannot be written to; choose another folder"):
            check_folder(folder, [])


def test_protected_files(tmp_path, protect):
    """Renaming a new file to the name of a protected one would succeed."""
    path = tmp_path / "old.exr"
    path.write_text("old")
    protect(path)
    message = "is protected from being written; choose another name"
    with pytest.raises(ValueError, match=rf"old\.exr: {message}"):
        check_file(path)
    with pytest.raises(ValueError, match=rf"old\.exr: {message}"):
        check_folder(tmp_path, [path.name])
    with pytest.raises(PermissionError, match=message):
        write_text(path, "new")
    with pytest.raises(PermissionError, match=message):
        write_image(path, np.zeros((2, 2, 3)))
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["old.exr"]


def test_names_that_are_too_long(tmp_path):
    """A name has at most 255 bytes, and so has that of the temporary file."""
    path = tmp_path / ("a" * 251 + ".txt")
    check_file(path)
    write_text(path, "long")
    assert path.read_text() == "long"
    with pytest.raises(OSError, match="File name too long"):
        check_file(tmp_path / ("a" * 256))


def test_images(tmp_path):
    check_image(tmp_path / "a.exr")
    with pytest.raises(ValueError, match=r"expected a file name that ends in \.exr or \.png"):
        check_image(tmp_path / "a.jpg")
    with pytest.raises(ValueError, match="OpenEXR takes only names in UTF-8"):
        check_image(tmp_path / os.fsdecode(b"caf\xe9.exr"))
    with pytest.raises(ValueError, match="make it first"):
        check_image(tmp_path / "none" / "a.png")
