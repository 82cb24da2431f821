"""Twin of the shape `lathe`: POV-Ray's `lathe`."""

from __future__ import annotations

import math

from . import Fields, Place, Solid, Surface, angle, axes, coincident, sdl
from ._outline import LEAST_AREA, Point, points, share, size, twice_area

# Corners of the polygon that represents a disk.
_CORNERS = 64


def _faces(outline: list[Point], closed: bool) -> coincident.Outline:
    """The flat segments, as the disks that contain them."""
    sense = -1.0 if closed and twice_area(outline) < 0 else 1.0

    def circle(radius: float, height: float) -> tuple:
        turns = [2 * math.pi * k / _CORNERS for k in range(_CORNERS)]
        return tuple((radius * math.cos(t), height, radius * math.sin(t)) for t in turns)

    flats = [
        coincident.Flat(circle(max(r, s), y), (0.0, -sense * math.copysign(1.0, s - r), 0.0))
        for (r, y), (s, other) in zip(outline, outline[1:])
        if y == other
    ]
    every = [corner for flat in flats for corner in flat.corners]
    return coincident.Outline(every, lambda: flats, closed)


def twin(fields: Fields, place: Place) -> Solid:
    """`outline`."""
    outline = points(fields, 2, [(1.0, 0.0), (1.0, 1.0)])
    closed = outline[0][0] == 0 and outline[-1][0] == 0
    if min(r for r, _ in outline) < 0:
        fields.error("outline", "expected distances from the axis of at least 0")
    elif any(r == 0 and s == 0 for (r, _), (s, _) in zip(outline, outline[1:])):
        fields.error("outline", "a segment lies on the axis")
    elif closed and abs(twice_area(outline)) <= LEAST_AREA * size(outline) ** 2:
        fields.error("outline", "encloses no area with the axis")
    x, y, z = axes(place)
    surface = Surface(angle(z, x), share(outline, f"sqrt({x}*{x}+{z}*{z})", y))
    scale = place.setting.scale
    path = ", ".join(sdl.vector((r * scale, height * scale)) for r, height in outline)
    body = f"lathe {{ linear_spline {len(outline)}, {path}"
    return Solid(body, surface, closed, outline=_faces(outline, closed))
