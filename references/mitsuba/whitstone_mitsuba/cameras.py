"""Cameras: perspective, orthographic, thin_lens and environment (model §4).

If Mitsuba has the same sensor, it generates the rays. There is no native sensor for a perspective
window with non-square pixels (`fov` implies square ones), a lens behind an off-centre window, or
the environment camera: their rays come from the model's formula in float64. The driver implements
the near limit itself, because Mitsuba's near clip is a plane only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, List, Optional, Tuple

import numpy as np

from whitstone_protocol.errors import Unsupported

from .fields import REQUIRED, Fields, there_are
from .runtime import mi

# Mitsuba starts rays on the near clip plane; a power of two makes undoing this exact. The far clip
# limits nothing here.
NEAR = 2.0**-7
FAR = 1e4

Hosted = Optional[Tuple[str, str]]

KINDS = ("perspective", "orthographic", "thin_lens", "environment")
# Cameras with an image window at a distance.
WINDOWED = ("perspective", "thin_lens")


@dataclass(frozen=True)
class Lens:
    """Radius and focus distance in metres; n x n lens samples."""

    aperture: float
    focus: float
    n: int

    def squares(self) -> np.ndarray:
        """(n², 2): lens samples in the unit square, before the map to the disk."""
        steps = (np.arange(self.n) + 0.5) / self.n
        return np.column_stack([np.tile(steps, self.n), np.repeat(steps, self.n)])

    def points(self) -> np.ndarray:
        """(n², 2): lens samples to the right and up, in metres."""
        p, q = (2 * self.squares() - 1).T
        wide = np.abs(p) > np.abs(q)
        s = np.where(wide, p, q)
        with np.errstate(invalid="ignore", divide="ignore"):
            phi = np.where(wide, math.pi / 4 * (q / p), math.pi / 2 - math.pi / 4 * (p / q))
        phi = np.where(s == 0, 0.0, phi)
        return self.aperture * np.column_stack([s * np.cos(phi), s * np.sin(phi)])


@dataclass(frozen=True)
class Camera:
    """Camera position, axes (columns u, v, w: right, up, backwards) and the window l, r, b, t at
    distance d, in metres.
    """

    kind: str
    origin: np.ndarray
    axes: np.ndarray
    window: Tuple[float, float, float, float, float]
    width: int
    height: int
    near: float = 0.0
    spherical: bool = False
    lens: Optional[Lens] = None

    def square_pixels(self) -> bool:
        left, right, bottom, top, _ = self.window
        return abs((right - left) * self.height - (top - bottom) * self.width) <= 1e-12 * (right - left) * self.height

    def native(self) -> bool:
        """Whether Mitsuba has this sensor."""
        left, right, bottom, top, _ = self.window
        if self.kind == "environment":
            return False
        if self.lens is not None:
            # Mitsuba's lens must have a positive size, and its window is centred.
            centred = abs(left + right) <= 1e-12 * (right - left) and abs(bottom + top) <= 1e-12 * (top - bottom)
            return self.lens.aperture > 0 and centred and self.square_pixels()
        return self.kind == "orthographic" or self.square_pixels()

    def hosted(self) -> Hosted:
        if self.kind == "environment":
            return self.kind, "Mitsuba has no panoramic sensor"
        if not self.native():
            return self.kind, "Mitsuba has no sensor for non-square pixels, nor for a lens behind an off-centre window"
        if self.near != 0:
            return self.kind, "the driver moves ray origins to the near limit: Mitsuba clips at a plane only"
        return None

    def plugin(self) -> dict:
        """The native sensor. If there is none, the sensor of an equivalent window with square
        pixels, for timing only.
        """
        left, right, bottom, top, distance = self.window
        matrix = np.eye(4)
        # Mitsuba's cameras look along +Z, with +X to the left.
        matrix[:3, :3] = self.axes * [-1, 1, -1]
        matrix[:3, 3] = self.origin
        if self.kind == "environment":
            raise Unsupported("camera: Mitsuba has no panoramic sensor")
        sensor: dict = {"type": "thinlens" if self.lens is not None else self.kind, "near_clip": NEAR, "far_clip": FAR}
        if self.lens is not None:
            sensor.update(aperture_radius=self.lens.aperture, focus_distance=self.lens.focus)
            sensor["fov"] = math.degrees(2 * math.atan2((right - left) / 2, distance))
            sensor["fov_axis"] = "x"
        elif self.kind == "perspective":
            sensor["fov"] = math.degrees(2 * math.atan2((right - left) / 2, distance))
            sensor["fov_axis"] = "x"
            sensor["principal_point_offset_x"] = (left + right) / 2 / (right - left)
            sensor["principal_point_offset_y"] = -(bottom + top) / 2 / (top - bottom)
        else:
            # Before the transform, its view is 2 wide and 2 * height / width high.
            centre = np.eye(4)
            centre[:2, 3] = -(left + right) / 2, (bottom + top) / 2
            scale = np.diag([(right - left) / 2, (top - bottom) / 2 * self.width / self.height, 1, 1])
            matrix = matrix @ centre @ scale
        sensor["to_world"] = mi.ScalarTransform4f(matrix)
        return sensor

    def build(self, samples: int = 1) -> "mi.Sensor":
        """The native sensor, with a film and a sampler that only `mi.render` uses."""
        film = {
            "type": "hdrfilm",
            "width": self.width,
            "height": self.height,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        }
        return mi.load_dict({**self.plugin(), "film": film, "sampler": {"type": "independent", "sample_count": samples}})

    def lens_points(self) -> int:
        """Number of lens samples; 0 without a lens."""
        return 0 if self.lens is None else self.lens.n**2

    def formula(self, x: np.ndarray, y: np.ndarray, point: Optional[np.ndarray] = None) -> Tuple[np.ndarray, np.ndarray]:
        """(3, n) float64: origins (before the near limit) and directions by the model; `point` is
        the index of the lens sample.
        """
        fx, fy = x / self.width, y / self.height
        u, v, w = (self.axes[:, axis : axis + 1] for axis in range(3))
        eye = np.repeat(self.origin[:, None], len(fx), axis=1)
        if self.kind == "environment":
            phi, theta = math.pi * (2 * fx - 1), math.pi * (0.5 - fy)
            return eye, np.cos(theta) * (np.sin(phi) * u - np.cos(phi) * w) + np.sin(theta) * v
        left, right, bottom, top, distance = self.window
        a, c = left + (right - left) * fx, top - (top - bottom) * fy
        if self.kind == "orthographic":
            return eye + a * u + c * v, np.repeat(-w, len(fx), axis=1)
        d = a * u + c * v - distance * w
        if self.lens is not None and point is not None:
            lens = self.lens.points()[point.astype(np.int64)]
            off = lens[:, 0] * u + lens[:, 1] * v
            eye = eye + off
            d = self.lens.focus / distance * d - off
        return eye, d / np.linalg.norm(d, axis=0)

    def starts(self, directions: np.ndarray) -> np.ndarray:
        """Distances from the origin at which rays start: the near limit."""
        if self.spherical or self.near == 0:
            return np.full(directions.shape[1], self.near)
        return self.near / -(self.axes[:, 2] @ directions)

    def rays(self, sensor: Optional["mi.Sensor"], x: np.ndarray, y: np.ndarray, point: Optional[np.ndarray] = None) -> Tuple[Any, Any]:
        """Origins and directions of rays through raster positions (float64, pixels, y down) and
        lens samples.
        """
        o, d = self.formula(x, y, point)
        if sensor is not None:
            fx, fy = x / self.width, y / self.height
            film = mi.Point2f(mi.Float(fx.astype(np.float32)), mi.Float(fy.astype(np.float32)))
            aperture = mi.Point2f(0.5)
            if self.lens is not None and point is not None:
                square = self.lens.squares()[point.astype(np.int64)].astype(np.float32)
                # Mitsuba's x runs to the left.
                aperture = mi.Point2f(mi.Float(np.ascontiguousarray(1 - square[:, 0])), mi.Float(np.ascontiguousarray(square[:, 1])))
            ray, _ = sensor.sample_ray(0.0, 0.5, film, aperture)
            if self.near == 0:
                # The model's rays start at the camera or on the lens, not on the near clip plane.
                start = mi.Point3f(ray.o - NEAR * ray.d) if self.kind == "orthographic" else _points(o)
                return start, mi.Vector3f(ray.d)
            d = mi.Vector3f(ray.d).numpy().astype(np.float64).reshape(3, -1)
        o = o + self.starts(d) * d
        return _points(o), mi.Vector3f(np.ascontiguousarray(d, dtype=np.float32))


def _points(values: np.ndarray) -> "mi.Point3f":
    return mi.Point3f(np.ascontiguousarray(values, dtype=np.float32))


def read(table: Any, width: int, height: int, errors: List[str], unsupported: List[str]) -> Optional[Camera]:
    """The `[camera]` table."""
    if table is None:
        errors.append("camera: is required")
        return None
    fields = Fields(table, "camera", errors)
    kind = fields.kind()
    if kind not in KINDS:
        if kind is not None:
            unsupported.append(f"camera: no twin for a camera of type {kind!r}; {there_are(KINDS)}")
        return None
    look = Fields(fields.take("look_at", REQUIRED) or {}, "camera.look_at", errors)
    origin, target = np.array(look.vector("origin", REQUIRED)), np.array(look.vector("target", REQUIRED))
    up = np.array(look.vector("up", (0.0, 1.0, 0.0)))
    look.close()
    window = _window(fields, kind, width, height) if kind != "environment" else (-1.0, 1.0, -1.0, 1.0, 1.0)
    near, spherical, lens = 0.0, False, None
    if kind in ("perspective", "orthographic"):
        near = fields.number("near", 0.0)
    if kind == "perspective":
        spherical = fields.choice("near_kind", "planar", ("planar", "spherical")) == "spherical"
    if kind == "thin_lens":
        lens = Lens(
            fields.number("aperture", REQUIRED, lambda metres: metres >= 0, "a radius >= 0 in metres"),
            fields.number("focus_distance", REQUIRED, lambda metres: metres > 0, "a distance > 0 in metres"),
            fields.integer("lens_samples", 4, 1, 64),
        )
    fields.close()
    backwards = origin - target
    if errors:
        return None
    backwards = _near_one(backwards)
    if not np.linalg.norm(backwards) > 0:
        look.error("target", "must differ from `origin`")
        return None
    w = backwards / np.linalg.norm(backwards)
    up = _near_one(up)
    u = np.cross(up, w)
    if np.linalg.norm(u) <= 1e-12 * np.linalg.norm(up):
        look.error("up", "must not be parallel to the view direction")
        return None
    u /= np.linalg.norm(u)
    return Camera(kind, origin, np.column_stack([u, np.cross(w, u), w]), window, width, height, near, spherical, lens)


def _near_one(v: np.ndarray) -> np.ndarray:
    """The vector times a power of two, so that its length does not overflow."""
    largest = np.abs(v).max()
    return v / np.exp2(np.floor(np.log2(largest))) if largest > 0 else v


def _window(fields: Fields, kind: str, width: int, height: int) -> Tuple[float, float, float, float, float]:
    """l, r, b, t, d from `window`, or from `fov` or `width`."""
    size_key = "fov" if kind in WINDOWED else "width"
    if fields.has("window"):
        for key in (size_key, "fov_axis"):
            if fields.has(key) and (key != "fov_axis" or kind in WINDOWED):
                fields.take(key)
                fields.error(key, "cannot be given together with `window`")
        inner = Fields(fields.take("window"), fields.where + ".window", fields.errors)
        left, right, bottom, top = (inner.number(key, REQUIRED) for key in "lrbt")
        distance = inner.number("d", 1.0, lambda d: d > 0, "a distance > 0") if kind in WINDOWED else 1.0
        inner.close()
        if not fields.errors and not (left < right and bottom < top):
            inner.error(None, "expected l < r and b < t")
        return left, right, bottom, top, distance
    if kind in WINDOWED:
        fov = fields.number("fov", 45.0, lambda angle: 0 < angle < 180, "an angle between 0 and 180 degrees")
        axis = fields.choice("fov_axis", "x", ("x", "y", "smaller", "larger"))
        half = math.tan(math.radians(fov) / 2)
        along_y = axis == "y" or (axis == "smaller" and height < width) or (axis == "larger" and height > width)
        half_x = half * width / height if along_y else half
    else:
        half_x = fields.number("width", 2.0, lambda metres: metres > 0, "a width > 0 in metres") / 2
    half_y = half_x * height / width
    return -half_x, half_x, -half_y, half_y, 1.0
