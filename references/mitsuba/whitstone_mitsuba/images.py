"""Image files as linear RGB float32 arrays (model §10: decoded *before* any filtering)."""

from __future__ import annotations

import os
from typing import Optional, Tuple

import numpy as np

from whitstone_protocol.errors import SceneError, Unsupported

from . import gltf
from .files import Folder
from .runtime import mi

# Upper bound on the size of an image inside a glTF file.
MAX_TEXELS = 2**27
CHANNELS = ("color", "alpha", "red", "green", "blue")


def srgb_to_linear(value: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1 decoding, in the precision of `value`."""
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def _pick_rgb(pixels: np.ndarray, names: list, path: str) -> np.ndarray:
    """The three colour channels of any file: alpha is ignored, grey is repeated."""
    where = {name.split(".")[-1].upper(): index for index, name in enumerate(names)}
    if all(name in where for name in "RGB"):
        return pixels[:, :, [where["R"], where["G"], where["B"]]]
    if "Y" in where:
        return np.repeat(pixels[:, :, where["Y"], None], 3, axis=2)
    raise SceneError(f"{path}: expected channels R, G, B or Y, found {', '.join(names)}")


def _pick_alpha(pixels: np.ndarray, names: list, path: str) -> np.ndarray:
    """The alpha channel, repeated three times."""
    where = {name.split(".")[-1].upper(): index for index, name in enumerate(names)}
    if "A" not in where:
        raise SceneError(f"{path}: expected a channel A, found {', '.join(names)}")
    return np.repeat(pixels[:, :, where["A"], None], 3, axis=2)


def codes(path: str) -> np.ndarray:
    """(height, width, 3) codes of an 8-bit file."""
    if not os.path.isfile(path):
        raise SceneError(f"{path}: no such file")
    try:
        bitmap = mi.Bitmap(path)
        names = [field.name for field in bitmap.struct_()]
        pixels = np.atleast_3d(np.array(bitmap))
    except Exception as error:  # Mitsuba raises RuntimeError with its own text
        raise SceneError(f"{path}: cannot be read as an image: {error}") from error
    if pixels.dtype != np.uint8:
        raise SceneError(f"{path}: expected 8 bits per channel")
    return _pick_rgb(pixels, names, path).astype(np.int64)


def load(path: str, color_space: str, channel: str = "color") -> np.ndarray:
    """(height, width, 3) float32, top row first. `color_space` is "auto", "srgb" or "linear"; alpha
    is always linear. A single channel is repeated three times.
    """
    if not os.path.isfile(path):
        raise SceneError(f"{path}: no such file")
    try:
        # The content tells the format: names may lack an extension.
        with open(path, "rb") as file:
            kind = _kind(file.read(12))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    if kind == "WebP":
        raise Unsupported(f"{path}: no twin for WebP images: Mitsuba does not read them")
    if kind is None:
        raise SceneError(f"{path}: expected a PNG, JPEG, WebP, EXR or HDR image")
    try:
        bitmap = mi.Bitmap(path, getattr(mi.Bitmap.FileFormat, kind))
    except Exception as error:  # Mitsuba raises RuntimeError with its own text
        raise SceneError(f"{path}: cannot be read as an image: {error}") from error
    return _decoded(bitmap, path, color_space, channel, kind not in ("OpenEXR", "RGBE"))


def _kind(data: bytes) -> Optional[str]:
    """The format of an image file that begins with these bytes."""
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "WebP"
    starts = (
        (b"\x89PNG\r\n\x1a\n", "PNG"),
        (b"\xff\xd8\xff", "JPEG"),
        (b"\x76\x2f\x31\x01", "OpenEXR"),
        (b"#?RADIANCE", "RGBE"),
        (b"#?RGBE", "RGBE"),
    )
    for start, kind in starts:
        if data.startswith(start):
            return kind
    return None


def inside(path: str, index: int, color_space: str, channel: str, base: Folder) -> np.ndarray:
    """`load` for an image of a glTF file. One without an alpha channel has the alpha 1."""
    file = gltf.load(path)
    try:
        node, data = file.image(index)
    finally:
        base.note(file.stamps)
    where = f"{path}: {node.pointer}"
    kind = _kind(data[:12])
    if kind == "WebP":
        raise Unsupported(f"{where}: no twin for WebP images: Mitsuba does not read them")
    if kind not in ("PNG", "JPEG"):
        raise SceneError(f"{where}: is neither PNG nor JPEG nor WebP")
    width, height = _size(data)
    if width * height > MAX_TEXELS:
        raise Unsupported(f"{where}: no twin for more than {MAX_TEXELS} texels, found {width} x {height}")
    stream = mi.MemoryStream(len(data))
    stream.write(data)
    stream.seek(0)
    try:
        bitmap = mi.Bitmap(stream, getattr(mi.Bitmap.FileFormat, kind))
    except Exception as error:  # as above
        raise SceneError(f"{where}: cannot be read as an image: {error}") from error
    return _decoded(bitmap, where, color_space, channel, True, True)


def _size(data: bytes) -> Tuple[int, int]:
    """The size in the header of a PNG or JPEG; (0, 0) if there is none."""
    if data[:1] == b"\x89":
        return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        kind = data[at + 1]
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            return int.from_bytes(data[at + 7 : at + 9], "big"), int.from_bytes(data[at + 5 : at + 7], "big")
        # Fill bytes and markers without data have no length.
        at += 1 if kind == 0xFF else 2 if kind == 0x01 or 0xD0 <= kind <= 0xD8 else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return 0, 0


def _decoded(bitmap: "mi.Bitmap", path: str, color_space: str, channel: str, by_default: bool, opaque: bool = False) -> np.ndarray:
    """The values of a bitmap. `by_default`: whether the colour space "auto" is sRGB; `opaque`:
    whether a missing alpha is 1.
    """
    names = [field.name for field in bitmap.struct_()]
    pixels = np.atleast_3d(np.array(bitmap))
    # Integer texels are fractions of the largest value of their type; float32 texels are values.
    scale = float(np.iinfo(pixels.dtype).max) if np.issubdtype(pixels.dtype, np.integer) else 1.0
    if channel == "alpha":
        if opaque and not any(name.split(".")[-1].upper() == "A" for name in names):
            return np.ones((*pixels.shape[:2], 3), dtype=np.float32)
        values = _pick_alpha(pixels, names, path).astype(np.float64) / scale
    else:
        values = _pick_rgb(pixels, names, path).astype(np.float64) / scale
        if channel != "color":
            values = np.repeat(values[:, :, [("red", "green", "blue").index(channel)]], 3, axis=2)
        if color_space == "srgb" or (color_space == "auto" and by_default):
            values = srgb_to_linear(values)
    if not np.all(np.isfinite(values)):
        raise SceneError(f"{path}: has non-finite texels")
    return np.ascontiguousarray(values, dtype=np.float32)
