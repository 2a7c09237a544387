"""Pictures as other programs write them are read, and what cannot be read is named."""

import os
import struct
import zlib

import numpy as np
import OpenEXR
import pytest
from drjit.llvm import ad
from PIL import Image, ImageCms

from whitted.files import exr_reading
from whitted.files.images import read_image, write_image
from whitted.files.png import from_srgb

HEIGHT, WIDTH = 5, 7
SCANLINES = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}


@pytest.fixture
def pixels():
    return np.random.default_rng(1).uniform(-1, 3, (HEIGHT, WIDTH, 3)).astype(np.float32)


@pytest.fixture
def exr(tmp_path):
    """A function that writes an EXR of some channels, or of several parts."""

    def exr(channels, **more):
        path = tmp_path / "a.exr"
        parts = channels if isinstance(channels, list) else None
        # OpenEXR adds to the header that it is given
        header = {**SCANLINES, **more}
        with OpenEXR.File(parts) if parts else OpenEXR.File(header, channels) as file:
            file.write(str(path))
        return path

    return exr


def named(pixels, prefix=""):
    """Three channels whose names begin with a prefix."""
    return {f"{prefix}{name}": pixels[..., k].copy() for k, name in enumerate("RGB")}


def same(image, expected):
    assert type(image) is ad.TensorXf
    np.testing.assert_array_equal(image.numpy(), expected)


def grey(values):
    return np.repeat(values[..., None], 3, axis=-1)


# EXR: types of channels


@pytest.mark.parametrize(
    "types", [("f2", "f4", "f4"), ("f2", "f2", "f2"), ("u4", "f4", "f2"), ("u4", "u4", "u4")]
)
def test_channels_of_any_type(exr, pixels, types):
    channels = {
        n: (abs(x) * 9).astype(t) for (n, x), t in zip(named(pixels).items(), types, strict=True)
    }
    expected = np.stack([channel.astype(np.float32) for channel in channels.values()], axis=-1)
    same(read_image(exr(channels)), expected)


def test_alpha_depth_and_names_in_lower_case(exr, pixels):
    other = np.full((HEIGHT, WIDTH), 0.5, np.float32)
    same(read_image(exr({**named(pixels), "A": other, "Z": other})), pixels)
    lower = {f"x.{name.lower()}": channel for name, channel in named(pixels).items()}
    same(read_image(exr(lower)), pixels)


@pytest.mark.parametrize("names", ["Y", "YA", "YZ"])
def test_grey(exr, pixels, names):
    channels = {name: pixels[..., k].copy() for k, name in enumerate(names)}
    same(read_image(exr(channels)), grey(pixels[..., 0]))


def test_tiles(exr, pixels):
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 3
    same(read_image(exr({"RGB": pixels}, type=OpenEXR.tiledimage, tiles=tiles)), pixels)


# EXR: windows


def window(left, top, right, bottom):
    return np.array([left, top], np.int32), np.array([right, bottom], np.int32)


@pytest.mark.parametrize(
    ("display", "shape", "inside", "of_data"),
    [
        # Within the display window
        ((0, 0, 15, 11), (12, 16), np.s_[3:8, 4:11], np.s_[:, :]),
        # The display window begins elsewhere, and the data reach beyond it
        ((6, -2, 8, 5), (8, 3), np.s_[5:8, :], np.s_[:3, 2:5]),
        # Apart from each other
        ((20, 20, 21, 20), (1, 2), np.s_[:0, :0], np.s_[:0, :0]),
    ],
)
def test_data_window_is_placed_in_the_display_window(exr, pixels, display, shape, inside, of_data):
    data = window(4, 3, 4 + WIDTH - 1, 3 + HEIGHT - 1)
    path = exr({"RGB": pixels}, dataWindow=data, displayWindow=window(*display))
    expected = np.zeros((*shape, 3), np.float32)
    expected[inside] = pixels[of_data]
    same(read_image(path), expected)


def test_display_window_of_billions_of_pixels(exr, pixels):
    path = exr({"RGB": pixels}, displayWindow=window(0, 0, 99_999, 99_999))
    with pytest.raises(ValueError, match=r"a\.exr: damaged, or too large: 100000 x 100000 pixels"):
        read_image(path)


# EXR: layers and parts


def test_the_only_layer_is_taken(exr, pixels):
    depth = {"Render.Depth.Z": pixels[..., 0].copy()}
    normal = {f"Render.Normal.{name}": pixels[..., 0].copy() for name in "XYZ"}
    path = exr({**named(pixels, "Render.Main."), **depth, **normal})
    same(read_image(path), pixels)
    same(read_image(path, layer="Render.Main"), pixels)


def test_several_layers(exr, pixels):
    layers = {**named(pixels, "light."), **named(2 * pixels, "fog.")}
    path = exr(layers)
    with pytest.raises(
        ValueError,
        match=r"a\.exr: there are several layers; name one by layer= or --layer: fog, light$",
    ):
        read_image(path)
    same(read_image(path, "light"), pixels)
    for name in ("lights", ""):
        with pytest.raises(
            ValueError, match=rf"there is no layer '{name}'; its layers are: fog, light$"
        ):
            read_image(path, name)
    # Plain channels beside layers are the picture itself
    path = exr({**layers, **named(3 * pixels)})
    same(read_image(path), 3 * pixels)
    same(read_image(path, "fog"), 2 * pixels)


def test_parts(exr, pixels):
    parts = [
        OpenEXR.Part(dict(SCANLINES), {"Z": pixels[..., 0].copy()}, "depth"),
        OpenEXR.Part(dict(SCANLINES), named(pixels), "one"),
        OpenEXR.Part(
            dict(SCANLINES), {**named(2 * pixels, "a."), **named(3 * pixels, "b.")}, "two"
        ),
    ]
    path = exr(parts)
    same(read_image(path), pixels)
    for layer, factor in (("one", 1), ("a", 2), ("two.b", 3)):
        same(read_image(path, layer), factor * pixels)
    with pytest.raises(ValueError, match=r"there are several layers; .*: one, two\.a, two\.b$"):
        read_image(path, "two")
    with pytest.raises(ValueError, match="there is no layer 'depth'; its layers are: one, two"):
        read_image(path, "depth")


# EXR: what cannot be read


@pytest.mark.parametrize("names", ["Z", "RG", "XYZ", ("Y", "BY", "RY")])
def test_no_picture(exr, pixels, names):
    told = ", ".join(sorted(names))
    path = exr({name: pixels[..., 0].copy() for name in names})
    with pytest.raises(ValueError, match=rf"not an RGB or a grey image .* channels are {told}$"):
        read_image(path)


def test_deep_images(exr):
    deep = np.empty((2, 3), object)
    for place in np.ndindex(deep.shape):
        deep[place] = np.ones(2, np.float32)
    more = {"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}
    path = exr({name: deep.copy() for name in "RGB"}, **more)
    with pytest.raises(ValueError, match=r"a\.exr: a deep image, which cannot be read; flatten"):
        read_image(path)


def test_channels_with_fewer_samples(tmp_path, exr, pixels, monkeypatch):
    """OpenEXR's Python does not write such files, so that one is made up here."""
    header = {name: window(0, 0, 3, 3) for name in ("dataWindow", "displayWindow")}
    channels = {"R": np.ones((4, 4)), "G": np.ones((4, 4)), "B": np.ones((2, 2))}
    part = exr_reading.Part("", header, channels)
    monkeypatch.setattr(exr_reading, "_parts", lambda path: [part])
    (tmp_path / "a.exr").touch()
    with pytest.raises(ValueError, match="channel B has a sample for several pixels"):
        read_image(tmp_path / "a.exr")


def test_a_part_that_is_damaged(exr, pixels):
    """OpenEXR goes on without it, so that another part would be the first."""
    path = exr([OpenEXR.Part(dict(SCANLINES), named(pixels), name) for name in ("one", "two")])
    # The last chunk is of the second part
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(ValueError, match=r"a\.exr: not an EXR, or damaged"):
        read_image(path)


def test_names_that_are_not_utf_8(tmp_path, pixels):
    exr, png = (tmp_path / os.fsdecode(b"caf\xe9" + ending) for ending in (b".exr", b".png"))
    message = r"caf\\udce9\.exr': OpenEXR takes only names in UTF-8; rename the file or its folder"
    with pytest.raises(ValueError, match=message):
        write_image(exr, pixels)
    assert list(tmp_path.iterdir()) == []
    exr.touch()
    with pytest.raises(ValueError, match=message):
        read_image(exr)
    write_image(png, np.ones((2, 2, 3)))
    same(read_image(png), np.ones((2, 2, 3)))


# PNG


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(path, values, *chunks):
    """Write a PNG of 8 or 16 bits, by the type and the channels of the values.

    Every second row is stored as differences from the one before.
    """
    height, width, count = values.shape
    stored = values.astype(values.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    rows = b"".join(
        bytes([2 * (y % 2)]) + (row - stored[y - 1] if y % 2 else row).tobytes()
        for y, row in enumerate(stored)
    )
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[count]
    start = struct.pack(">IIBBBBB", width, height, 8 * values.itemsize, kind, 0, 0, 0)
    parts = [chunk(b"IHDR", start), *chunks, chunk(b"IDAT", zlib.compress(rows))]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts) + chunk(b"IEND", b""))
    return path


def gamma(value):
    return chunk(b"gAMA", struct.pack(">I", round(value * 100_000)))


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_png_of_8_or_16_bits(tmp_path, kind, channels):
    """Grey, grey with alpha, RGB, RGB with alpha; alpha is ignored."""
    most = np.iinfo(kind).max
    values = np.random.default_rng(2).integers(0, most, (HEIGHT, WIDTH, channels), endpoint=True)
    values = values.astype(kind)
    encoded = values[..., :3] if channels > 2 else grey(values[..., 0])
    path = png(tmp_path / "a.png", values)
    same(read_image(path), from_srgb(encoded / most).astype(np.float32))
    # A gamma of 1 is linear
    same(read_image(png(path, values, gamma(1))), (encoded / most).astype(np.float32))


@pytest.mark.parametrize(
    ("chunks", "exponent"),
    [
        ([gamma(0.5)], 2),
        ([gamma(0.45455)], 1 / 0.45455),
        # The file says that it is sRGB, whatever its gamma; a gamma of 0 says nothing
        ([gamma(0.5), chunk(b"sRGB", b"\0")], None),
        ([gamma(0)], None),
    ],
)
def test_gamma(tmp_path, chunks, exponent):
    encoded = np.linspace(0, 1, 256)
    values = np.arange(256, dtype=np.uint8).reshape(16, 16, 1)
    linear = encoded**exponent if exponent else from_srgb(encoded)
    image = read_image(png(tmp_path / "a.png", values, *chunks))
    np.testing.assert_allclose(image.numpy()[..., 1].ravel(), linear, atol=1e-7)


@pytest.mark.parametrize("bits", [1, 4, 8])
def test_palettes(tmp_path, bits):
    colors = np.random.default_rng(3).integers(0, 256, (1 << bits, 3), dtype=np.uint8)
    index = np.random.default_rng(4).integers(0, 1 << bits, (HEIGHT, WIDTH), dtype=np.uint8)
    image = Image.fromarray(index).convert("P")
    image.putpalette(colors.tobytes())
    # Transparency is ignored, as alpha is
    image.save(tmp_path / "a.png", bits=bits, transparency=0)
    expected = from_srgb(colors[index] / 255).astype(np.float32)
    same(read_image(tmp_path / "a.png"), expected)


def test_black_and_white(tmp_path):
    bits = np.random.default_rng(5).random((HEIGHT, WIDTH)) < 0.5
    Image.fromarray(bits).save(tmp_path / "a.png")
    same(read_image(tmp_path / "a.png"), grey(bits.astype(np.float32)))


def profile(linear):
    """The bytes of sRGB's colour profile, or of one like it that is linear."""
    data = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    # The curve of a channel: its kind, and gamma, a, b, c and d in fixed-point numbers
    at = data.index(b"para")
    curve = data[at : at + 32]
    one = (1 << 16, 1 << 16, 0, 1 << 16, 0)
    return data.replace(curve, curve[:12] + struct.pack(">5I", *one)) if linear else data


def test_colour_profiles(tmp_path):
    """That of sRGB goes before a gamma; others are refused."""
    values = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, -1)
    path = tmp_path / "a.png"

    def embedded(data):
        return chunk(b"iCCP", b"a profile\0\0" + zlib.compress(data))

    for data in (profile(linear=False), b"damaged"):
        png(path, values, embedded(data), gamma(1))
        same(read_image(path), from_srgb(values / 255).astype(np.float32))
    png(path, values, embedded(profile(linear=True)))
    message = r"a\.png: its colour profile, 'sRGB.*', is not sRGB; convert the picture to sRGB"
    with pytest.raises(ValueError, match=message):
        read_image(path)


def test_coded_colours(tmp_path):
    """Those of sRGB go before a gamma; others, as of pictures for bright screens, are refused."""
    values = np.arange(256, dtype=np.uint8).reshape(16, 16, 1)
    path = png(tmp_path / "a.png", values, chunk(b"cICP", bytes([1, 13, 0, 1])), gamma(1))
    same(read_image(path), from_srgb(grey(values[..., 0]) / 255).astype(np.float32))
    png(path, values, chunk(b"cICP", bytes([9, 16, 0, 1])))
    message = r"a\.png: its colours are coded by primaries 9 and transfer 16 \(cICP\), not as sRGB"
    with pytest.raises(ValueError, match=message):
        read_image(path)


def test_png_has_no_layers(tmp_path):
    path = png(tmp_path / "a.png", np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(ValueError, match=r"a\.png: a PNG has no layers; leave layer='fog' out"):
        read_image(path, "fog")


def test_png_without_pixels(tmp_path):
    start = chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 2, 8, 2, 0, 0, 0))
    path = tmp_path / "a.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + start + chunk(b"IEND", b""))
    with pytest.raises(ValueError, match=r"a\.png: not a readable PNG: it has no pixels"):
        read_image(path)


# Integers are no radiance


class Tensor:
    """What PyTorch's tensors look like from outside."""

    def __init__(self, array):
        self.array = array

    def numpy(self):
        return self.array


@pytest.mark.parametrize(
    ("image", "kind", "whole"),
    [
        (np.zeros((2, 2, 3), np.uint8), "uint8", 255),
        (np.zeros((2, 2, 3), np.uint16), "uint16", 65535),
        (ad.TensorXi([0] * 12, (2, 2, 3)), "int32", 255),
        (Tensor(np.zeros((2, 2, 3), np.int64)), "int64", 255),
        ([[[0, 0, 0]]], "int64", 255),
    ],
)
@pytest.mark.parametrize("ending", ["exr", "png"])
def test_integers_are_not_written(tmp_path, image, kind, whole, ending):
    message = (
        rf"a\.{ending}: integers \({kind}\) are no radiance; divide by {whole} and make them "
        "linear, as read_image does with a file, or convert radiance to float"
    )
    with pytest.raises(ValueError, match=message):
        write_image(tmp_path / f"a.{ending}", image)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("image", ["picture", None, np.zeros((2, 2, 3), complex), [[0.0], [1, 2]]])
def test_what_is_no_array_of_numbers_is_not_written(tmp_path, image):
    kind = type(image).__name__
    with pytest.raises(ValueError, match=rf"expected an array of numbers, got {kind}"):
        write_image(tmp_path / "a.exr", image)
