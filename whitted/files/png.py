"""PNG files: written as sRGB in 8 bits (IEC 61966-2-1), read with 8 or 16 bits."""

import io
from pathlib import Path
from typing import Any

import numpy as np

# Pillow keeps the first byte of a sample of 16 bits. Its decoder gives the second one if it is told
# that samples are stored in another way; grey with alpha then passes for four channels of 8 bits
SECOND_BYTES = {"RGB;16B": "RGB;16L", "RGBA;16B": "RGBA;16L", "LA;16B": "RGBA"}
# The chunk whose first two bytes are numbers of colour primaries and of a transfer function (ITU-T
# H.273), and those of sRGB
CODE, SRGB_CODE = b"cICP", b"\x01\x0d"
# A colour profile is sRGB if it changes colours by no more than this, in steps of 1 / 255
SAME_COLOR = 3


def to_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear values, clipped to [0, 1], as sRGB in [0, 1]; NaN becomes 0."""
    x = np.clip(np.nan_to_num(linear, nan=0.0), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def from_srgb(encoded: np.ndarray) -> np.ndarray:
    """sRGB in [0, 1] as linear values in [0, 1]."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def in_8_bits(pixels: np.ndarray) -> np.ndarray:
    """Linear RGB of shape (height, width, 3), clipped to [0, 1], as sRGB from 0 to 255."""
    # Encode row by row: the double-precision intermediates of a large image take much memory
    encoded = np.empty(pixels.shape, dtype=np.uint8)
    for row, out in zip(pixels, encoded, strict=True):
        out[:] = to_srgb(row) * 255 + 0.5
    return encoded


def write(path: Path, pixels: np.ndarray) -> None:
    """Write a PNG from linear RGB of shape (height, width, 3), clipped to [0, 1].

    Raises:
        OSError: the file cannot be written.
    """
    from PIL import Image

    Image.fromarray(in_8_bits(pixels)).save(path)


def read(path: Path) -> np.ndarray:
    """Read a PNG as linear RGB of shape (height, width, 3), without its alpha channel.

    Samples are sRGB, unless the file has a gamma (`gAMA`) and does not say that it is sRGB.

    Raises:
        ValueError: not a PNG, a damaged one, or one with colours other than sRGB's.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        encoded, info = _samples(path)
    except (
        UnidentifiedImageError,
        OSError,
        ValueError,
        SyntaxError,
        Image.DecompressionBombError,
    ) as error:
        raise ValueError(f"{path}: not a readable PNG: {error}") from None
    profile, gamma, code = info.get("icc_profile"), info.get("gamma"), info[CODE]
    if code not in (b"", SRGB_CODE):
        raise ValueError(
            f"{path}: its colours are coded by primaries {code[0]} and transfer {code[1]} (cICP), "
            "not as sRGB; convert the picture to sRGB"
        )
    if code:
        return from_srgb(encoded)
    if profile and (other := _other_than_srgb(profile)):
        raise ValueError(
            f"{path}: its colour profile, '{other}', is not sRGB; convert the picture to sRGB"
        )
    if profile or "srgb" in info or not gamma:
        return from_srgb(encoded)
    return encoded ** (1 / gamma)


def _samples(path: Path) -> tuple[np.ndarray, dict[Any, Any]]:
    """Encoded RGB in [0, 1], and what else the file says."""
    raw, info, pixels = _decoded(path)
    if raw == "I;16B":
        return np.repeat(pixels[..., None] / 65535, 3, axis=-1), info
    if raw not in SECOND_BYTES:
        return pixels[..., :3] / 255, info
    _, _, other = _decoded(path, SECOND_BYTES[raw])
    if raw == "LA;16B":
        # High and low byte of grey, then of alpha
        return np.repeat((other[..., :1] * 256.0 + other[..., 1:2]) / 65535, 3, axis=-1), info
    return (pixels[..., :3] * 256.0 + other[..., :3]) / 65535, info


def _decoded(path: Path, raw: str | None = None) -> tuple[str, dict[Any, Any], np.ndarray]:
    """How the file stores its samples, what else it says, and the samples that Pillow makes of it.

    Args:
        raw: how Pillow shall take the samples, in place of what the file says.
    """
    from PIL import Image

    with Image.open(path, formats=["PNG"]) as image:
        if not image.tile:
            raise ValueError("it has no pixels")
        codec, extents, offset, own = image.tile[0]
        if raw:
            tiles: list[Any] = [(codec, extents, offset, raw)]
            image.tile = tiles
        image.load()
        # Pillow does not tell of this chunk, which is before the pixels
        with path.open("rb") as file:
            code = file.read(offset).partition(CODE)[2][:2]
        pixels = np.asarray(image if own == "I;16B" else image.convert("RGBA"))
        return str(own), {**image.info, CODE: code}, pixels


def _other_than_srgb(profile: bytes) -> str | None:
    """The name of a colour profile, None if it makes the same of colours as sRGB does."""
    from PIL import Image, ImageCms

    levels = np.linspace(0, 255, 6).astype(np.uint8)
    colors = np.stack(np.meshgrid(levels, levels, levels), -1).reshape(36, 6, 3)
    try:
        own = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        kind = "L" if own.profile.xcolor_space.strip() == "GRAY" else "RGB"
        given = Image.fromarray(colors).convert(kind)
        srgb = ImageCms.createProfile("sRGB")
        shown = ImageCms.profileToProfile(given, own, srgb, outputMode="RGB")
        name = ImageCms.getProfileDescription(own).strip()
    except (OSError, ValueError, ImageCms.PyCMSError):
        # A damaged profile says nothing
        return None
    difference = np.asarray(shown, float) - np.asarray(given.convert("RGB"), float)
    return name if abs(difference).max() > SAME_COLOR else None
