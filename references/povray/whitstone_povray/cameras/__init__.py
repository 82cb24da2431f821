"""Cameras (model §4): `twin(fields, width, height)` returns a `Camera`.

A lens is rendered as one camera per lens sample. Each of these cameras looks through the same
window of the focal plane.

POV-Ray shows the point `location + direction + x right + y up` at x, y from -1/2 to 1/2 across the
image. These vectors are given explicitly, without `look_at` and `angle`, so POV-Ray uses them
unchanged and a right-handed world needs no mirroring.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Optional, Tuple

from .. import registry, sdl
from ..fields import REQUIRED, Context, Fields, Vector
from ..settings import Setting
from ..transforms import cross, sub, unit

Window = Tuple[float, float, float, float]


@dataclass(frozen=True)
class Camera:
    """Position, axes (right, up, backwards), and the window l, r, b, t at distance d; lengths in
    metres.
    """

    kind: str
    origin: Vector
    axes: Tuple[Vector, Vector, Vector]
    window: Window
    distance: float
    width: int
    height: int
    # Lens samples, in metres to the right and up, and the focus distance.
    lens: Tuple[Tuple[float, float], ...] = ((0.0, 0.0),)
    focus: float = 1.0

    def samples(self, positions: List[Tuple[float, float]]) -> List[Tuple[float, float, int]]:
        """Every combination of a position in a pixel and the index of a lens sample."""
        return [(x, y, point) for x, y in positions for point in range(len(self.lens))]

    def origins(self, setting: Setting, samples: List[Tuple[float, float, int]]) -> str:
        """Origins of rays in POV-Ray's language: calls of the macro `Starts` with a point, or of
        `Window` with a corner, two sides and numbers of pixels.
        """
        if self.kind == "perspective":
            u, v, _ = self.axes
            points = sorted({self.lens[point] for _, _, point in samples})
            places = (tuple(e + x * p + y * q for e, p, q in zip(self.origin, u, v)) for x, y in points)
            return "\n".join(f"Starts({sdl.vector(setting.scale * c for c in place)})" for place in places)
        left, right, bottom, top = self.window
        u, v, _ = self.axes
        corner = [e + left * p + bottom * q for e, p, q in zip(self.origin, u, v)]
        sides = ([(right - left) * p for p in u], [(top - bottom) * q for q in v])
        vectors = ", ".join(sdl.vector(setting.scale * c for c in vector) for vector in (corner, *sides))
        return f"Window({vectors}, {self.width}, {self.height})"

    def write(self, setting: Setting, dx: float, dy: float, point: int = 0) -> str:
        """The camera, shifted by `dx` pixels to the right and `dy` down, for one lens sample."""
        left, right, bottom, top = self.window
        u, v, w = self.axes
        a = (left + right) / 2 + dx * (right - left) / self.width
        c = (bottom + top) / 2 - dy * (top - bottom) / self.height
        if self.kind == "perspective":
            x, y = self.lens[point]
            location = tuple(e + x * p + y * q for e, p, q in zip(self.origin, u, v))
            # Shift of the window per metre on the lens, which keeps the focal plane fixed.
            part = self.distance / self.focus
            direction = tuple((a - part * x) * p + (c - part * y) * q - self.distance * r for p, q, r in zip(u, v, w))
            size = 1.0
        else:
            location = tuple(e + a * p + c * q for e, p, q in zip(self.origin, u, v))
            direction = tuple(-component for component in w)
            size = setting.scale
        vectors = {
            "location": [setting.scale * component for component in location],
            "direction": direction,
            "right": [size * (right - left) * component for component in u],
            "up": [size * (top - bottom) * component for component in v],
        }
        return f"camera {{ {self.kind} " + " ".join(f"{name} {sdl.vector(value)}" for name, value in vectors.items()) + " }"


def window_of(fields: Fields, other: str) -> Optional[Tuple[Window, float]]:
    """The key `window`, which excludes `other`; None if it is missing."""
    if not fields.has("window"):
        return None
    inner = Fields(fields.take("window"), fields.where + ".window", fields.context)
    left, right, bottom, top = (inner.number(key, REQUIRED) for key in "lrbt")
    distance = inner.number("d", 1.0, lambda d: d > 0, "a distance > 0")
    inner.close()
    if not (left < right and bottom < top) and not fields.context.errors:
        inner.error("", "expected l < r and b < t")
    if fields.has(other):
        fields.error(other, "cannot be given together with window")
    return (left, right, bottom, top), distance


def placed(fields: Fields, kind: str, window: Window, distance: float, width: int, height: int) -> Camera:
    """The camera that `look_at` defines."""
    look = Fields(fields.take("look_at", REQUIRED), fields.where + ".look_at", fields.context)
    origin, target = look.vector("origin", REQUIRED), look.vector("target", REQUIRED)
    up = look.vector("up", (0.0, 1.0, 0.0))
    look.close()
    w = unit(sub(origin, target))
    u = unit(cross(up, w))
    if not any(u) and not fields.context.errors:
        look.error("", "`target` must differ from `origin`, and `up` must not be parallel to the view direction")
    return Camera(kind, origin, (u, cross(w, u), w), window, distance, width, height)


def read(table: Any, width: int, height: int, context: Context) -> Optional[Camera]:
    """The `[camera]` table."""
    fields = Fields(table, "camera", context)
    twin = registry.find("cameras", fields)
    if twin is None:
        return None
    camera = twin(fields, width, height)
    fields.close()
    return camera
