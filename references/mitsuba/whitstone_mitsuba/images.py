"""Image files as linear RGB float32 arrays (model §10: decoded *before* any filtering)."""

from __future__ import annotations

import os

import numpy as np

from .errors import SceneError
from .runtime import mi

EXTENSIONS = (".png", ".jpg", ".jpeg", ".exr")


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


def load(path: str, color_space: str, alpha: bool = False) -> np.ndarray:
    """(height, width, 3) float32, top row first. `color_space` is "auto", "srgb" or "linear"; alpha
    is always linear.
    """
    extension = os.path.splitext(path)[1].lower()
    if extension not in EXTENSIONS:
        raise SceneError(f"{path}: expected an image file ending in {', '.join(EXTENSIONS)}")
    if not os.path.isfile(path):
        raise SceneError(f"{path}: no such file")
    try:
        bitmap = mi.Bitmap(path)
        names = [field.name for field in bitmap.struct_()]
        pixels = np.atleast_3d(np.array(bitmap))
    except Exception as error:  # Mitsuba raises RuntimeError with its own text
        raise SceneError(f"{path}: cannot be read as an image: {error}") from error
    # Integer texels are fractions of the largest value of their type; float32 texels are values.
    scale = float(np.iinfo(pixels.dtype).max) if np.issubdtype(pixels.dtype, np.integer) else 1.0
    pick = _pick_alpha if alpha else _pick_rgb
    values = pick(pixels, names, path).astype(np.float64) / scale
    if not alpha and (color_space == "srgb" or (color_space == "auto" and extension != ".exr")):
        values = srgb_to_linear(values)
    if not np.all(np.isfinite(values)):
        raise SceneError(f"{path}: has non-finite texels")
    return np.ascontiguousarray(values, dtype=np.float32)
