"""Writes OpenEXR: scan lines, ZIP, float32, channels R, G, B (model §12).

Source: the OpenEXR file layout, https://openexr.com/en/latest/OpenEXRFileLayout.html.
"""

from __future__ import annotations

import os
import struct
import tempfile
import zlib
from typing import List, Sequence

_LINES, _ZIP, _FLOAT = 16, 3, 2


def _attribute(name: str, kind: str, value: bytes) -> bytes:
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value


def _compress(raw: bytes) -> bytes:
    """Even bytes before odd ones, differences, deflate; uncompressed if that is not smaller."""
    data = raw[0::2] + raw[1::2]
    differences = data[:1] + bytes((b - a + 128) & 255 for a, b in zip(data, data[1:]))
    packed = zlib.compress(differences, 4)
    return packed if len(packed) < len(raw) else raw


def encode(rows: List[List[Sequence[float]]]) -> bytes:
    """The file's bytes; top row first, each colour R, G, B."""
    height, width = len(rows), len(rows[0])
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    names = ("B", "G", "R")
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
    blocks = []
    for first in range(0, height, _LINES):
        lines = rows[first : first + _LINES]
        raw = b"".join(struct.pack(f"<{width}f", *(color[k] for color in row)) for row in lines for k in (2, 1, 0))
        packed = _compress(raw)
        blocks.append(struct.pack("<2i", first, len(packed)) + packed)
    offsets, position = [], len(header) + 8 * len(blocks)
    for block in blocks:
        offsets.append(position)
        position += len(block)
    return header + struct.pack(f"<{len(offsets)}Q", *offsets) + b"".join(blocks)


def write(path: str, rows: List[List[Sequence[float]]]) -> None:
    """Writes to a temporary file in the same folder and renames it, so that no reader sees an
    incomplete image.
    """
    handle, temporary = tempfile.mkstemp(prefix=".whitstone-", suffix=".exr", dir=os.path.dirname(os.path.abspath(path)))
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(encode(rows))
        # mkstemp restricts access to the owner; an image gets the usual permissions.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
