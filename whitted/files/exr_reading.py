"""OpenEXR files as other programs write them: parts, layers, windows, channels of any type."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

RGB = ("R", "G", "B")
# Beside one of these Y is no grey: luminance of a picture in colour, or part of a vector
NOT_GREY = {"X", "RY", "BY"}
# Pixels of a display window, at most: a damaged header may tell of billions
MOST_PIXELS = 1 << 27


@dataclass(frozen=True)
class Part:
    """One of the images that a file holds."""

    name: str  # "" if it has none
    header: Mapping[str, Any]
    channels: Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Picture:
    """Channels of a part that make a picture: red, green and blue, or grey alone."""

    part: Part
    layer: str  # what the channels' names begin with, "" where they are plain R, G, B or Y
    channels: Sequence[str]

    @property
    def name(self) -> str:
        return ".".join(name for name in dict.fromkeys((self.part.name, self.layer)) if name)


def read(path: Path, layer: str | None) -> np.ndarray:
    """Read a picture of an EXR file.

    Args:
        layer: a layer, a part, or both as in "part.layer"; None: the plain channels of the first
            part with a picture, or its only layer.

    Returns:
        Linear RGB of shape (height, width, 3), float32, of the size of the display window.

    Raises:
        ValueError: not an EXR, a damaged one, or one without the picture that is asked for.
    """
    parts = _parts(path)
    pictures = [picture for part in parts for picture in _pictures(part)]
    if not pictures:
        names = ", ".join(name for part in parts for name in part.channels) or "none"
        raise ValueError(
            f"{path}: not an RGB or a grey image (R, G, B or Y); its channels are {names}"
        )
    return _pixels(path, _chosen(path, pictures, layer))


def _parts(path: Path) -> list[Part]:
    """The parts of a file."""
    import OpenEXR

    try:
        # OpenEXR leaves out a part that it cannot read
        with OpenEXR.File(str(path), header_only=True) as file:
            count = len(file.parts)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            parts = [_part(part) for part in file.parts]
    except (RuntimeError, TypeError, ValueError, MemoryError):
        parts, count = [], 0
    if not parts or len(parts) < count:
        raise ValueError(f"{path}: not an EXR, or damaged")
    return parts


def _part(part: Any) -> Part:
    channels = {name: channel.pixels for name, channel in part.channels.items()}
    return Part(part.name(), dict(part.header), channels)


def _pictures(part: Part) -> Iterator[Picture]:
    """The pictures of a part, that of its plain channels first."""
    layers: dict[str, dict[str, str]] = {}
    for name in part.channels:
        layer, _, kind = name.rpartition(".")
        layers.setdefault(layer, {})[kind.upper()] = name
    for layer, names in sorted(layers.items()):
        if names.keys() >= set(RGB):
            yield Picture(part, layer, [names[kind] for kind in RGB])
        elif "Y" in names and NOT_GREY.isdisjoint(names):
            yield Picture(part, layer, [names["Y"]])


def _chosen(path: Path, pictures: Sequence[Picture], layer: str | None) -> Picture:
    """The picture of this layer or part, or of the first part."""
    for picture in pictures:
        if layer and layer in (picture.layer, picture.name):
            return picture
    within = [one for one in pictures if layer is None or one.part.name == layer]
    names = ", ".join(one.name for one in pictures if one.name) or "none"
    if not within or layer == "":
        raise ValueError(f"{path}: there is no layer '{layer}'; its layers are: {names}")
    first, *others = [one for one in within if one.part is within[0].part]
    if first.layer and others:
        raise ValueError(
            f"{path}: there are several layers; name one by layer= or --layer: {names}"
        )
    return first


def _pixels(path: Path, picture: Picture) -> np.ndarray:
    """A picture's pixels, placed in the display window; black where the file has none."""
    left, top, right, bottom = _window(picture, "dataWindow")
    x, y, x_end, y_end = _window(picture, "displayWindow")
    width, height = x_end - x, y_end - y
    if not (width > 0 and height > 0 and width * height <= MOST_PIXELS):
        raise ValueError(f"{path}: damaged, or too large: {width} x {height} pixels")
    pixels = np.zeros((height, width, 3), np.float32)
    # The part of the data that lies in the display window
    columns = slice(max(left, x), min(right, x_end))
    rows = slice(max(top, y), min(bottom, y_end))
    for k, name in enumerate(picture.channels):
        data = picture.part.channels[name]
        if data.dtype.kind not in "fu":
            raise ValueError(f"{path}: a deep image, which cannot be read; flatten it first")
        if data.shape != (bottom - top, right - left):
            raise ValueError(
                f"{path}: channel {name} has a sample for several pixels, which cannot be "
                "read; save it with one for each"
            )
        if columns.start < columns.stop and rows.start < rows.stop:
            # One channel is grey, which all three get
            to = slice(k, k + 1) if len(picture.channels) == 3 else slice(None)
            part = data[_moved(rows, top), _moved(columns, left)]
            pixels[_moved(rows, y), _moved(columns, x), to] = part[..., None]
    return pixels


def _window(picture: Picture, name: str) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of a window; the last two are just beyond it."""
    (left, top), (right, bottom) = np.asarray(picture.part.header[name]).tolist()
    return left, top, right + 1, bottom + 1


def _moved(span: slice, by: int) -> slice:
    return slice(span.start - by, span.stop - by)
