"""Image files: what is written is read back, and what is not an image is refused."""

import stat

import numpy as np
import OpenEXR
import pytest
from drjit.llvm import ad
from PIL import Image

from whitted.files.images import clipped, read_image, write_image
from whitted.files.png import from_srgb, to_srgb


@pytest.fixture
def pixels():
    return np.random.default_rng(1).uniform(-1, 3, (5, 7, 3)).astype(np.float32)


def test_exr_comes_back_bit_for_bit(tmp_path, pixels):
    write_image(tmp_path / "a.exr", ad.TensorXf(pixels))
    image = read_image(tmp_path / "a.exr")
    assert type(image) is ad.TensorXf
    np.testing.assert_array_equal(image.numpy(), pixels)


def test_exr_header_and_channels(tmp_path, pixels):
    write_image(tmp_path / "a.exr", pixels, {"spp": 4, "precision": "single", "renderSeconds": 0.5})
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        header = file.header()
        assert set(file.channels()) == {"R", "G", "B"}
        assert file.channels()["G"].pixels.dtype == np.float32
        np.testing.assert_array_equal(file.channels()["G"].pixels, pixels[..., 1])
        assert header["compression"] == OpenEXR.ZIP_COMPRESSION
        assert header["type"] == OpenEXR.scanlineimage
        assert (header["spp"], header["precision"], header["renderSeconds"]) == (4, "single", 0.5)


def test_double_precision_image_is_written_as_float32(tmp_path, pixels):
    write_image(tmp_path / "a.exr", ad.TensorXf64(pixels.astype(np.float64)))
    np.testing.assert_array_equal(read_image(tmp_path / "a.exr").numpy(), pixels)


def test_png_is_srgb_of_the_clipped_values(tmp_path, pixels):
    write_image(tmp_path / "a.png", pixels)
    with Image.open(tmp_path / "a.png") as file:
        stored = np.asarray(file)
    assert (stored.shape, stored.dtype) == ((5, 7, 3), np.uint8)
    assert (stored[pixels <= 0] == 0).all()
    assert (stored[pixels >= 1] == 255).all()
    # Rounding to 8 bits changes the encoded value by at most half a step of 1 / 255
    np.testing.assert_allclose(
        to_srgb(read_image(tmp_path / "a.png").numpy()), to_srgb(pixels), atol=0.5 / 255 + 1e-6
    )


def test_clipped_counts_pixels():
    image = np.full((2, 2, 3), 0.5)
    image[0, 0, 1], image[1, 1] = 1.5, np.nan
    assert clipped(image) == 0.5


def test_srgb_known_values():
    """IEC 61966-2-1: 50 % sRGB is 21.4 % linear; the two pieces meet at 0.04045."""
    assert from_srgb(np.array(0.5)) == pytest.approx(0.21404, abs=1e-5)
    np.testing.assert_allclose(
        from_srgb(to_srgb(np.linspace(0, 1, 1001))), np.linspace(0, 1, 1001), atol=2e-8
    )


@pytest.mark.parametrize("ending", [".exr", ".png"])
def test_old_file_is_replaced_and_nothing_else_left(tmp_path, pixels, ending):
    path = tmp_path / f"a{ending}"
    path.write_bytes(b"old")
    write_image(path, pixels)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert read_image(path).shape == (5, 7, 3)
    assert stat.S_IMODE(path.stat().st_mode) & stat.S_IRUSR


def test_failed_write_keeps_the_old_file(tmp_path, pixels, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", fail)
    with pytest.raises(OSError, match=r"No space left on device.*a\.png"):
        write_image(path, pixels)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


def test_exr_that_cannot_be_finished(tmp_path, pixels, monkeypatch):
    def fail(*_):
        raise RuntimeError("write failed")

    monkeypatch.setattr(OpenEXR.File, "write", fail)
    with pytest.raises(OSError, match=r"cannot be written; is the disk full\?.*a\.exr"):
        write_image(tmp_path / "a.exr", pixels)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 4), (0, 7, 3)])
def test_other_shapes_are_refused(tmp_path, shape):
    with pytest.raises(ValueError, match=r"expected an image of shape \(height, width, 3\), got"):
        write_image(tmp_path / "a.exr", np.zeros(shape))


def test_arguments_in_the_other_order(tmp_path, pixels):
    with pytest.raises(
        TypeError, match=r"^path: expected the name of a file, got a ndarray; as in"
    ):
        write_image(pixels, tmp_path / "a.png")


@pytest.mark.parametrize("name", ["a.jpg", "a"])
def test_other_endings_are_refused(tmp_path, pixels, name):
    with pytest.raises(ValueError, match=r"expected a file name that ends in \.exr or \.png"):
        write_image(tmp_path / name, pixels)
    with pytest.raises(ValueError, match=r"expected a file name that ends in \.exr or \.png"):
        read_image(tmp_path / name)


def test_folders_and_missing_files(tmp_path, pixels):
    (tmp_path / "a.exr").mkdir()
    with pytest.raises(IsADirectoryError, match="is a folder; name a file"):
        write_image(tmp_path / "a.exr", pixels)
    with pytest.raises(FileNotFoundError, match=r"b\.exr"):
        write_image(tmp_path / "none" / "b.exr", pixels)
    with pytest.raises(FileNotFoundError):
        read_image(tmp_path / "b.exr")


def test_not_an_image(tmp_path, pixels):
    for ending, kind in ((".exr", "EXR"), (".png", "PNG")):
        (tmp_path / f"a{ending}").write_bytes(b"not an image" * 100)
        with pytest.raises(ValueError, match=rf"a\{ending}: not an? (readable )?{kind}"):
            read_image(tmp_path / f"a{ending}")
        write_image(tmp_path / f"b{ending}", pixels)
        whole = (tmp_path / f"b{ending}").read_bytes()
        (tmp_path / f"b{ending}").write_bytes(whole[: len(whole) // 2])
        with pytest.raises(ValueError, match=rf"b\{ending}: not an? (readable )?{kind}"):
            read_image(tmp_path / f"b{ending}")
