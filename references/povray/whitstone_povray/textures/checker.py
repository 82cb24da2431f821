"""Twin of the texture `checker`: a function. POV-Ray's own `checker` is three-dimensional, with a
tolerance.
"""

from __future__ import annotations

from ..fields import Vector, is_number
from . import Fields, Point, Texture, function, sdl, two_colors


def pair(fields: Fields, key: str, default: float) -> Vector:
    """One number for both axes, or two."""
    value = fields.take(key, default)
    return (float(value),) * 2 if is_number(value) else fields.vector(key, (default,) * 2, 2)


def twin(fields: Fields) -> Texture:
    """`a`, `b`, `scale`, `offset`, `mapping`."""
    size, offset = pair(fields, "scale", 1.0), fields.vector("offset", [0.0, 0.0], 2)

    def value(q: Point) -> str:
        cells = [f"floor({q[k]}*{sdl.number(size[k])}+{sdl.number(offset[k])})" for k in range(2)]
        return f"abs(mod({cells[0]}+{cells[1]},2))"

    return function(fields, "uv", two_colors(fields), value)
