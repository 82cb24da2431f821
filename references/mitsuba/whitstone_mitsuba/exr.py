"""Writes OpenEXR: scan lines, ZIP, float32, named channels (model §12).

Mitsuba's `Bitmap` can only write PIZ, and adds a comment to the header. This writer gives the same
bytes for the same values. Source: the OpenEXR file layout,
https://openexr.com/en/latest/OpenEXRFileLayout.html.
"""

from __future__ import annotations

import os
import struct
import tempfile
import zlib
from typing import Dict

import numpy as np

_LINES_PER_BLOCK = 16  # lines per block of ZIP_COMPRESSION
_ZIP = 3
_FLOAT = 2


def _attribute(name: str, kind: str, value: bytes) -> bytes:
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def _compress(raw: bytes) -> bytes:
    """OpenEXR's ZIP: even bytes before odd ones, differences, deflate; uncompressed if that is not
    smaller.
    """
    data = np.frombuffer(raw, dtype=np.uint8)
    data = np.concatenate([data[0::2], data[1::2]])
    differences = data.copy()
    differences[1:] = data[1:] - data[:-1] + np.uint8(128)
    packed = zlib.compress(differences.tobytes(), 4)
    return packed if len(packed) < len(raw) else raw


def encode(channels: Dict[str, np.ndarray]) -> bytes:
    """The file's bytes; every channel is (height, width) float32, top row first."""
    names = sorted(channels)
    height, width = channels[names[0]].shape
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    listing = b"".join(name.encode() + b"\0" + struct.pack("<i4B2i", _FLOAT, 0, 0, 0, 0, 1, 1) for name in names) + b"\0"
    header = b"".join(
        [
            struct.pack("<2i", 20000630, 2),
            _attribute("channels", "chlist", listing),
            _attribute("compression", "compression", bytes([_ZIP])),
            _attribute("dataWindow", "box2i", box),
            _attribute("displayWindow", "box2i", box),
            _attribute("lineOrder", "lineOrder", b"\0"),
            _attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
            _attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
            _attribute("screenWindowWidth", "float", struct.pack("<f", 1)),
            b"\0",
        ]
    )
    # In a block: line by line, and in each line channel by channel.
    planes = np.stack([np.asarray(channels[name], dtype="<f4") for name in names], axis=1)
    blocks = []
    for first in range(0, height, _LINES_PER_BLOCK):
        packed = _compress(planes[first : first + _LINES_PER_BLOCK].tobytes())
        blocks.append(struct.pack("<2i", first, len(packed)) + packed)
    offsets, position = [], len(header) + 8 * len(blocks)
    for block in blocks:
        offsets.append(position)
        position += len(block)
    return header + struct.pack(f"<{len(offsets)}Q", *offsets) + b"".join(blocks)


def write(path: str, channels: Dict[str, np.ndarray]) -> None:
    """Writes to a temporary file in the same folder and renames it, so that no reader sees an
    incomplete image.
    """
    folder = os.path.dirname(os.path.abspath(path))
    handle, temporary = tempfile.mkstemp(prefix=".whitstone-", suffix=".exr", dir=folder)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(encode(channels))
        # mkstemp restricts access to the owner; an image gets the usual permissions.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
