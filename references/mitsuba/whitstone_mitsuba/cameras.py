"""Cameras: perspective and orthographic (model §4).

Where Mitsuba has the same sensor, it makes the rays; a perspective window whose pixels are not square has no twin (`fov` fixes
square pixels), and its rays come from the model's formula in float64.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, List, Optional, Tuple

import numpy as np

from .fields import REQUIRED, Fields, nearest
from .runtime import dr, mi

# Mitsuba starts rays on the near clip; a power of two keeps taking it off again exact. The far clip limits nothing here.
NEAR = 2.0**-7
FAR = 1e4

Hosted = Optional[Tuple[str, str]]


@dataclass(frozen=True)
class Camera:
    """Eye, axes (columns u, v, w: right, up, backwards) and the window l, r, b, t at distance d, in metres."""

    kind: str
    origin: np.ndarray
    axes: np.ndarray
    window: Tuple[float, float, float, float, float]
    width: int
    height: int

    def square_pixels(self) -> bool:
        left, right, bottom, top, _ = self.window
        return abs((right - left) * self.height - (top - bottom) * self.width) <= 1e-12 * (right - left) * self.height

    def native(self) -> bool:
        """Whether Mitsuba has this sensor."""
        return self.kind == "orthographic" or self.square_pixels()

    def hosted(self) -> Hosted:
        return None if self.native() else ("perspective", "a window with pixels that are not square has no native sensor")

    def plugin(self) -> dict:
        """The native sensor (of an equivalent square-pixel window where it has none: for timing only)."""
        left, right, bottom, top, distance = self.window
        matrix = np.eye(4)
        # Mitsuba's cameras look along +Z with +X to the left.
        matrix[:3, :3] = self.axes * [-1, 1, -1]
        matrix[:3, 3] = self.origin
        sensor: dict = {"type": self.kind, "near_clip": NEAR, "far_clip": FAR}
        if self.kind == "perspective":
            sensor["fov"] = math.degrees(2 * math.atan2((right - left) / 2, distance))
            sensor["fov_axis"] = "x"
            sensor["principal_point_offset_x"] = (left + right) / 2 / (right - left)
            sensor["principal_point_offset_y"] = -(bottom + top) / 2 / (top - bottom)
        else:
            # Its view is 2 wide and 2 * height / width high before the transform.
            centre = np.eye(4)
            centre[:2, 3] = -(left + right) / 2, (bottom + top) / 2
            scale = np.diag([(right - left) / 2, (top - bottom) / 2 * self.width / self.height, 1, 1])
            matrix = matrix @ centre @ scale
        sensor["to_world"] = mi.ScalarTransform4f(matrix)
        return sensor

    def build(self, samples: int = 1) -> "mi.Sensor":
        """The native sensor with a film and a sampler that only `mi.render` looks at."""
        film = {
            "type": "hdrfilm",
            "width": self.width,
            "height": self.height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        }
        return mi.load_dict({**self.plugin(), "film": film, "sampler": {"type": "independent", "sample_count": samples}})

    def rays(self, sensor: Optional["mi.Sensor"], x: np.ndarray, y: np.ndarray) -> Tuple[Any, Any]:
        """Origins and directions of the rays through raster positions (float64, pixels, y down)."""
        fx, fy = x / self.width, y / self.height
        if sensor is None:
            left, right, bottom, top, distance = self.window
            a, c = left + (right - left) * fx, top - (top - bottom) * fy
            d = np.outer(self.axes[:, 0], a) + np.outer(self.axes[:, 1], c) - distance * self.axes[:, 2:3]
            d /= np.linalg.norm(d, axis=0)
            return self._eye(len(fx)), mi.Vector3f(np.ascontiguousarray(d, dtype=np.float32))
        film = mi.Point2f(mi.Float(fx.astype(np.float32)), mi.Float(fy.astype(np.float32)))
        ray, _ = sensor.sample_ray(0.0, 0.5, film, mi.Point2f(0.5))
        if self.kind == "perspective":
            # The model's rays start at the eye, not on the near clip.
            return self._eye(len(fx)), mi.Vector3f(ray.d)
        return mi.Point3f(ray.o - NEAR * ray.d), mi.Vector3f(ray.d)

    def _eye(self, count: int) -> "mi.Point3f":
        return mi.Point3f(*[dr.full(mi.Float, float(np.float32(value)), count) for value in self.origin])


def read(table: Any, width: int, height: int, errors: List[str], unsupported: List[str]) -> Optional[Camera]:
    """The `[camera]` table."""
    if table is None:
        errors.append("camera: is required")
        return None
    fields = Fields(table, "camera", errors)
    kind = fields.kind()
    if kind not in ("perspective", "orthographic"):
        if kind is not None:
            known = ["perspective", "orthographic"]
            unsupported.append(f"camera: no twin for a camera of type {kind!r}; {nearest(kind, known)}")
        return None
    look = Fields(fields.take("look_at", REQUIRED) or {}, "camera.look_at", errors)
    origin, target = np.array(look.vector("origin", REQUIRED)), np.array(look.vector("target", REQUIRED))
    up = np.array(look.vector("up", (0.0, 1.0, 0.0)))
    look.close()
    window = _window(fields, kind, width, height)
    fields.close()
    backwards = origin - target
    if errors:
        return None
    if not np.linalg.norm(backwards) > 0:
        look.error("target", "must differ from the origin")
        return None
    w = backwards / np.linalg.norm(backwards)
    u = np.cross(up, w)
    if np.linalg.norm(u) <= 1e-12 * np.linalg.norm(up):
        look.error("up", "must not be parallel to the view")
        return None
    u /= np.linalg.norm(u)
    return Camera(kind, origin, np.column_stack([u, np.cross(w, u), w]), window, width, height)


def _window(fields: Fields, kind: str, width: int, height: int) -> Tuple[float, float, float, float, float]:
    """l, r, b, t, d from `window`, or from `fov` or `width`."""
    size_key = "fov" if kind == "perspective" else "width"
    if fields.has("window"):
        for key in (size_key, "fov_axis"):
            if fields.has(key) and (key != "fov_axis" or kind == "perspective"):
                fields.take(key)
                fields.error(key, "cannot be given together with window")
        inner = Fields(fields.take("window"), fields.where + ".window", fields.errors)
        left, right, bottom, top = (inner.number(key, REQUIRED) for key in "lrbt")
        distance = inner.number("d", 1.0, lambda d: d > 0, "a distance > 0") if kind == "perspective" else 1.0
        inner.close()
        if not fields.errors and not (left < right and bottom < top):
            inner.error(None, "expected l < r and b < t")
        return left, right, bottom, top, distance
    if kind == "perspective":
        fov = fields.number("fov", 45.0, lambda angle: 0 < angle < 180, "an angle between 0 and 180 degrees")
        axis = fields.choice("fov_axis", "x", ("x", "y", "smaller", "larger"))
        half = math.tan(math.radians(fov) / 2)
        along_y = axis == "y" or (axis == "smaller" and height < width) or (axis == "larger" and height > width)
        half_x = half * width / height if along_y else half
    else:
        half_x = fields.number("width", 2.0, lambda metres: metres > 0, "a width > 0 in metres") / 2
    half_y = half_x * height / width
    return -half_x, half_x, -half_y, half_y, 1.0
