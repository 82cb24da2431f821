"""Reads the OpenEXR files that POV-Ray writes (scan lines, ZIP, half floats R, G, B), and the range
of values that round to a half float.

Source: the OpenEXR file layout, https://openexr.com/en/latest/OpenEXRFileLayout.html.
"""

from __future__ import annotations

import math
import struct
import zlib
from itertools import accumulate
from typing import Dict, List, Sequence, Tuple

from .errors import DriverError

Color = Tuple[float, float, float]
# Left, top, right, bottom in pixels; right and bottom are exclusive.
Window = Tuple[int, int, int, int]

_ZIP, _HALF, _LINES = 3, 1, 16


def read(path: str, window: Window) -> List[List[Color]]:
    """Rows of colours inside a window, which the file must contain."""
    with open(path, "rb") as file:
        data = file.read()
    attributes, at = _header(data)
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    columns = x1 - x0 + 1
    names = [name for name, kind in _channels(attributes["channels"]) if kind == _HALF]
    if names != ["B", "G", "R"] or attributes["compression"][0] != _ZIP:
        raise DriverError(f"povray wrote an unexpected image: channels {names}, compression {attributes['compression'][0]}")
    blocks = (y1 - y0) // _LINES + 1
    rows: Dict[int, List[Color]] = {}
    for offset in struct.unpack_from(f"<{blocks}Q", data, at):
        # POV-Ray omits the lines above a window; offsets of omitted lines are 0.
        if offset == 0:
            continue
        first, size = struct.unpack_from("<2i", data, offset)
        if first + _LINES <= window[1] or first >= window[3]:
            continue
        lines = min(_LINES, y1 + 1 - first)
        values = _block(data[offset + 8 : offset + 8 + size], 6 * columns * lines)
        for line in range(lines):
            start = 3 * columns * line
            blue, green, red = (values[start + k * columns : start + (k + 1) * columns] for k in range(3))
            rows[first + line] = list(zip(red, green, blue))
    return [rows[y][window[0] - x0 : window[2] - x0] for y in range(window[1], window[3])]


def _header(data: bytes) -> Tuple[Dict[str, bytes], int]:
    if data[:4] != b"\x76\x2f\x31\x01":
        raise DriverError("povray's image is not an OpenEXR file")
    at, attributes = 8, {}
    while data[at]:
        end = data.index(b"\0", at)
        kind = data.index(b"\0", end + 1)
        (size,) = struct.unpack_from("<i", data, kind + 1)
        attributes[data[at:end].decode()] = data[kind + 5 : kind + 5 + size]
        at = kind + 5 + size
    return attributes, at + 1


def _channels(listing: bytes) -> List[Tuple[str, int]]:
    at, found = 0, []
    while listing[at]:
        end = listing.index(b"\0", at)
        found.append((listing[at:end].decode(), struct.unpack_from("<i", listing, end + 1)[0]))
        at = end + 17
    return found


def _block(packed: bytes, size: int) -> Sequence[float]:
    """OpenEXR's ZIP: deflated differences of even bytes before odd ones; uncompressed if that was
    not smaller.
    """
    if len(packed) < size:
        differences = zlib.decompress(packed)
        plain = bytes(value & 255 for value in accumulate(differences, lambda a, b: a + b - 128))
        raw = bytearray(size)
        raw[0::2], raw[1::2] = plain[: (size + 1) // 2], plain[(size + 1) // 2 :]
        packed = bytes(raw)
    return struct.unpack(f"<{size // 2}e", packed)


def bracket(half: float) -> Tuple[float, float]:
    """The smallest and the largest number that round to this half."""
    if half == 0:
        return -(2.0**-25), 2.0**-25
    if not math.isfinite(half):
        return half, half
    magnitude = abs(half)
    mantissa, exponent = math.frexp(magnitude)
    step = 2.0 ** max(exponent - 11, -24)
    # Below a power of two, halves are twice as dense.
    below = step / 2 if mantissa == 0.5 and exponent > -13 else step
    low, high = magnitude - below / 2, magnitude + step / 2
    return (low, high) if half > 0 else (-high, -low)
