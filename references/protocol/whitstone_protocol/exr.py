"""Writes OpenEXR files (scan lines, ZIP, float32, named channels: model §12), and reads the parts
of such files.

Image libraries differ in compression and header; this writer gives the same bytes for the same
values. Source: the OpenEXR file layout, https://openexr.com/en/latest/OpenEXRFileLayout.html.
"""

from __future__ import annotations

import os
import struct
import tempfile
import zlib
from itertools import accumulate
from typing import Dict, List, Mapping, Tuple

MAGIC = struct.pack("<i", 20000630)
# Pixel types of channels.
HALF, FLOAT = 1, 2
# A kind of compression, and its number of lines per block.
ZIP, LINES_PER_BLOCK = 3, 16


def _attribute(name: str, kind: str, value: bytes) -> bytes:
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def compress(raw: bytes) -> bytes:
    """OpenEXR's ZIP: even bytes before odd ones, differences, deflate; uncompressed if that is not
    smaller.
    """
    packed = zlib.compress(_differences(raw[0::2] + raw[1::2]), 4)
    return packed if len(packed) < len(raw) else raw


def _differences(data: bytes) -> bytes:
    """The first byte, then the difference of each byte and the one before it, plus 128 mod 256."""
    count = len(data) - 1
    if count < 1:
        return data
    # All bytes at once, as one large integer each: Python is slow byte by byte, and NumPy is not
    # everywhere. The highest bit of each byte, set first, keeps borrows out of the next byte; the
    # last term computes that bit itself, with 128 added.
    high = int.from_bytes(b"\x80" * count, "little")
    after, before = int.from_bytes(data[1:], "little"), int.from_bytes(data[:-1], "little")
    differences = ((after | high) - (before & ~high)) ^ ((after ^ before) & high)
    return data[:1] + differences.to_bytes(count, "little")


def decompress(packed: bytes, size: int) -> bytes:
    """The inverse of `compress`, for a block of `size` bytes."""
    if len(packed) >= size:
        return packed
    plain = bytes(value & 255 for value in accumulate(zlib.decompress(packed), lambda a, b: a + b - 128))
    raw = bytearray(size)
    raw[0::2], raw[1::2] = plain[: (size + 1) // 2], plain[(size + 1) // 2 :]
    return bytes(raw)


def encode(width: int, height: int, channels: Mapping[str, bytes]) -> bytes:
    """The file's bytes; every channel holds float32 in little-endian order, top row first."""
    names = sorted(channels)
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    listing = b"".join(name.encode() + b"\0" + struct.pack("<i4B2i", FLOAT, 0, 0, 0, 0, 1, 1) for name in names) + b"\0"
    header = b"".join(
        [
            MAGIC,
            struct.pack("<i", 2),
            _attribute("channels", "chlist", listing),
            _attribute("compression", "compression", bytes([ZIP])),
            _attribute("dataWindow", "box2i", box),
            _attribute("displayWindow", "box2i", box),
            _attribute("lineOrder", "lineOrder", b"\0"),
            _attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
            _attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
            _attribute("screenWindowWidth", "float", struct.pack("<f", 1)),
            b"\0",
        ]
    )
    row = 4 * width
    for name in names:
        assert len(channels[name]) == row * height, f"{name}: {len(channels[name])} bytes for {width} x {height}"
    blocks = []
    for first in range(0, height, LINES_PER_BLOCK):
        # In a block: line by line, and in each line channel by channel.
        lines = range(first, min(first + LINES_PER_BLOCK, height))
        packed = compress(b"".join(channels[name][row * line : row * (line + 1)] for line in lines for name in names))
        blocks.append(struct.pack("<2i", first, len(packed)) + packed)
    offsets, position = [], len(header) + 8 * len(blocks)
    for block in blocks:
        offsets.append(position)
        position += len(block)
    return header + struct.pack(f"<{len(offsets)}Q", *offsets) + b"".join(blocks)


def write(path: str, width: int, height: int, channels: Mapping[str, bytes]) -> None:
    """Writes to a temporary file in the same folder and renames it, so that no reader sees an
    incomplete image.
    """
    folder = os.path.dirname(os.path.abspath(path))
    handle, temporary = tempfile.mkstemp(prefix=".whitstone-", suffix=".exr", dir=folder)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(encode(width, height, channels))
        # mkstemp restricts access to the owner; an image gets the usual permissions.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def header(data: bytes) -> Tuple[Dict[str, bytes], int]:
    """The attributes of a file, and the position of its table of offsets."""
    at, attributes = 8, {}
    while data[at]:
        end = data.index(b"\0", at)
        kind = data.index(b"\0", end + 1)
        (size,) = struct.unpack_from("<i", data, kind + 1)
        attributes[data[at:end].decode()] = data[kind + 5 : kind + 5 + size]
        at = kind + 5 + size
    return attributes, at + 1


def channel_types(listing: bytes) -> List[Tuple[str, int]]:
    """Name and pixel type of each channel, from the attribute `channels`."""
    at, found = 0, []
    while listing[at]:
        end = listing.index(b"\0", at)
        found.append((listing[at:end].decode(), struct.unpack_from("<i", listing, end + 1)[0]))
        at = end + 17
    return found
