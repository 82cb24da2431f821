"""Twin of the shape `polygon`: POV-Ray's `polygon`, drawn in the plane z = 0 and transformed to its
own plane.
"""

from __future__ import annotations

import math
from typing import Any, List, Sequence

from ..fields import is_number
from ..transforms import cross, dot, sub, unit
from . import Fields, Place, Solid, Surface, axes, sdl

MOST_VERTICES = 4096
FLATNESS = 1e-9


def _points(fields: Fields) -> List[Sequence[float]]:
    def good(value: Any) -> bool:
        return isinstance(value, list) and len(value) == 3 and all(map(is_number, value))

    value = fields.take("vertices")
    if not isinstance(value, list) or not 3 <= len(value) <= MOST_VERTICES or not all(map(good, value)):
        fields.error("vertices", f"expected 3 to {MOST_VERTICES} arrays of 3 finite numbers")
        return [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    return [tuple(map(float, row)) for row in value]


def _area(vertices: List[Sequence[float]]) -> List[float]:
    """N of the model: twice the area as a vector."""
    middle = [math.fsum(column) / len(vertices) for column in zip(*vertices)]
    arms = [sub(vertex, middle) for vertex in vertices]
    parts = [cross(a, b) for a, b in zip(arms, arms[1:] + arms[:1])]
    return [math.fsum(column) for column in zip(*parts)]


def twin(fields: Fields, place: Place) -> Solid:
    """`vertices`. It does not check that edges meet only at their ends; the tested program does."""
    vertices = _points(fields)
    area = _area(vertices)
    size = math.hypot(*(max(column) - min(column) for column in zip(*vertices)))
    if math.hypot(*area) <= FLATNESS * size * size:
        fields.error("vertices", "enclose no area")
        area = [0.0, 0.0, 1.0]
    normal = unit(area)
    middle = [math.fsum(column) / len(vertices) for column in zip(*vertices)]
    farthest = max(abs(dot(sub(vertex, middle), normal)) for vertex in vertices)
    if farthest > FLATNESS * size:
        fields.error("vertices", f"must lie in a plane; they are up to {farthest:g} m away from it")
    # Texture coordinates omit the axis along which the normal is largest; the first one wins ties.
    largest = max(map(abs, normal)) * (1 - 1e-9)
    left_out = next(axis for axis in range(3) if abs(normal[axis]) >= largest)
    own = axes(place)
    surface = Surface(own[(left_out + 1) % 3], own[(left_out + 2) % 3])
    # A frame in the plane: POV-Ray requires points that are exactly coplanar.
    side = unit(cross(normal, [float(axis == (left_out + 1) % 3) for axis in range(3)]))
    up = cross(normal, side)
    scale = place.setting.scale
    flat = [(dot(sub(vertex, middle), side) * scale, dot(sub(vertex, middle), up) * scale, 0.0) for vertex in vertices]
    corners = ", ".join(sdl.vector(corner) for corner in flat + flat[:1])
    frame = sdl.vector([*side, *up, *normal, *(scale * component for component in middle)])
    return Solid(f"polygon {{ {len(flat) + 1}, {corners} matrix {frame}", surface, False)
