"""Writing a tiled OpenEXR file a few tiles at a time, in any order.

OpenEXR's Python module writes whole images only. Source of the layout: "OpenEXR File Layout", and
of the compression "ZIP" of the library's `ImfZip.cpp`.
"""

import struct
import zlib
from collections.abc import Mapping
from types import TracebackType
from typing import BinaryIO

import numpy as np

# Pixels along a side of a tile
TILE = 64
# The magic number, and version 2 with the flag of single tiled images
BEGIN = struct.pack("<II", 20000630, 2 | 0x200)
FLOAT, ZIP, RANDOM_ORDER, ONE_LEVEL = 2, 3, 2, 0


# Attributes that tell how the file is laid out
RESERVED = {
    "channels",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    "pixelAspectRatio",
    "screenWindowCenter",
    "screenWindowWidth",
    "tiles",
    "name",
    "type",
    "version",
    "chunkCount",
}


def check_attributes(metadata: Mapping[str, str | int | float]) -> None:
    """Refuse attributes that a header cannot have.

    Raises:
        ValueError: the message has the attribute.
    """
    if not isinstance(metadata, Mapping):
        raise ValueError(f"metadata: expected a dictionary of names and values, got {metadata!r}")
    for name, value in metadata.items():
        fits = isinstance(name, str) and 0 < len(name.encode()) < 256 and "\0" not in name
        if not fits or name in RESERVED:
            raise ValueError(
                "metadata: expected names of 1 to 255 characters, but none that tells how the file "
                f"is laid out, got {name!r}"
            )
        whole = isinstance(value, int) and -(1 << 31) <= value < 1 << 31
        if not (whole or isinstance(value, (str, float))):
            raise ValueError(
                f"metadata: {name}: expected a text, a number, or a whole number of 32 bits, "
                f"got {value!r}"
            )


class TiledFile:
    """A tiled EXR that is being written: float32 R, G, B in ZIP-compressed tiles."""

    def __init__(
        self, file: BinaryIO, size: tuple[int, int], metadata: Mapping[str, str | int | float]
    ) -> None:
        """Begin a file.

        Args:
            file: an empty one.
            size: width and height in pixels.
            metadata: further attributes of the header.
        """
        self.file, self.width, self.height = file, *size
        self.columns, self.rows = -(-self.width // TILE), -(-self.height // TILE)
        file.write(BEGIN + _header(size, metadata))
        self.table = file.tell()
        # Where each tile is, to be filled in
        self.offsets = np.zeros(self.rows * self.columns, "<u8")
        file.write(self.offsets.tobytes())

    def __enter__(self) -> "TiledFile":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.file.seek(self.table)
            self.file.write(self.offsets.tobytes())

    def write(self, first: int, pixels: np.ndarray) -> None:
        """Write a band of rows.

        Args:
            first: its first row, a multiple of TILE.
            pixels: (rows, width, 3), of whole tiles, but for the last band.
        """
        row = first // TILE
        for k in range(0, len(pixels), TILE):
            for column in range(self.columns):
                tile = pixels[k : k + TILE, column * TILE : (column + 1) * TILE]
                data = compressed(tile)
                self.offsets[row * self.columns + column] = self.file.tell()
                place = struct.pack("<iiiii", column, row, 0, 0, len(data))
                self.file.write(place + data)
            row += 1


def compressed(tile: np.ndarray) -> bytes:
    """A tile's bytes: row by row, in each first all B, then G, then R."""
    planes = np.ascontiguousarray(tile[..., ::-1].swapaxes(1, 2), "<f4")
    raw = np.frombuffer(planes.tobytes(), np.uint8)
    # Bytes at even places come first; then each is stored less the one before it
    split = np.concatenate([raw[::2], raw[1::2]])
    changes = split.copy()
    changes[1:] += np.uint8(128) - split[:-1]
    data = zlib.compress(changes.tobytes(), 4)
    return data if len(data) < raw.size else raw.tobytes()


def _header(size: tuple[int, int], metadata: Mapping[str, str | int | float]) -> bytes:
    width, height = size
    channels = b"".join(
        name + b"\0" + struct.pack("<iB3xii", FLOAT, 0, 1, 1) for name in (b"B", b"G", b"R")
    )
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    attributes = {
        "channels": ("chlist", channels + b"\0"),
        "compression": ("compression", bytes([ZIP])),
        "dataWindow": ("box2i", window),
        "displayWindow": ("box2i", window),
        "lineOrder": ("lineOrder", bytes([RANDOM_ORDER])),
        "pixelAspectRatio": ("float", struct.pack("<f", 1)),
        "screenWindowCenter": ("v2f", struct.pack("<ff", 0, 0)),
        "screenWindowWidth": ("float", struct.pack("<f", 1)),
        "tiles": ("tiledesc", struct.pack("<IIB", TILE, TILE, ONE_LEVEL)),
        **{name: _attribute(value) for name, value in metadata.items()},
    }
    return (
        b"".join(
            name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data
            for name, (kind, data) in attributes.items()
        )
        + b"\0"
    )


def _attribute(value: str | int | float) -> tuple[str, bytes]:
    if isinstance(value, str):
        return "string", value.encode()
    if isinstance(value, int):
        return "int", struct.pack("<i", value)
    return "float", struct.pack("<f", value)
