"""Twin of the texture `grid_lines`: a function."""

from __future__ import annotations

from . import Fields, Point, Texture, function, sdl, two_colors
from .checker import pair


def twin(fields: Fields) -> Texture:
    """`a`, `b`, `width`, `scale`, `offset`, `mapping`."""
    width, size = pair(fields, "width", 0.1), pair(fields, "scale", 1.0)
    if not all(0 <= number <= 1 for number in width):
        fields.error("width", f"expected widths from 0 to 1, found {width}")
    offset = fields.vector("offset", [0.0, 0.0], 2)

    def on_line(x: str, wide: float) -> str:
        # `select` returns its second argument if the first is below 0.
        return f"select(min({x}-floor({x}),1-({x}-floor({x})))-{sdl.number(wide / 2)},1,0)"

    def value(q: Point) -> str:
        x, y = (f"({q[k]}*{sdl.number(size[k])}+{sdl.number(offset[k])})" for k in range(2))
        return f"max({on_line(x, width[0])},{on_line(y, width[1])})"

    return function(fields, "uv", two_colors(fields), value)
