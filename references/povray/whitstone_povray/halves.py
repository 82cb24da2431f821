"""Reads the OpenEXR files that POV-Ray writes (scan lines, ZIP, half floats R, G, B), and the range
of values that round to a half float.
"""

from __future__ import annotations

import math
import struct
from typing import Dict, List, Tuple

from whitstone_protocol import exr
from whitstone_protocol.errors import DriverError

Color = Tuple[float, float, float]
# Left, top, right, bottom in pixels; right and bottom are exclusive.
Window = Tuple[int, int, int, int]


def read(path: str, window: Window) -> List[List[Color]]:
    """Rows of colours inside a window, which the file must contain."""
    with open(path, "rb") as file:
        data = file.read()
    if not data.startswith(exr.MAGIC):
        raise DriverError("povray's image is not an OpenEXR file")
    attributes, at = exr.header(data)
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    columns = x1 - x0 + 1
    names = [name for name, kind in exr.channel_types(attributes["channels"]) if kind == exr.HALF]
    if names != ["B", "G", "R"] or attributes["compression"][0] != exr.ZIP:
        raise DriverError(f"povray wrote an unexpected image: channels {names}, compression {attributes['compression'][0]}")
    blocks = (y1 - y0) // exr.LINES_PER_BLOCK + 1
    rows: Dict[int, List[Color]] = {}
    for offset in struct.unpack_from(f"<{blocks}Q", data, at):
        # POV-Ray omits the lines above a window; offsets of omitted lines are 0.
        if offset == 0:
            continue
        first, size = struct.unpack_from("<2i", data, offset)
        if first + exr.LINES_PER_BLOCK <= window[1] or first >= window[3]:
            continue
        lines = min(exr.LINES_PER_BLOCK, y1 + 1 - first)
        count = 3 * columns * lines
        block = exr.decompress(data[offset + 8 : offset + 8 + size], 2 * count)
        values = struct.unpack(f"<{count}e", block)
        for line in range(lines):
            start = 3 * columns * line
            blue, green, red = (values[start + k * columns : start + (k + 1) * columns] for k in range(3))
            rows[first + line] = list(zip(red, green, blue))
    return [rows[y][window[0] - x0 : window[2] - x0] for y in range(window[1], window[3])]


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
