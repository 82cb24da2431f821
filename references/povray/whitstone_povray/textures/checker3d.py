"""Twin of the texture `checker3d`: a function."""

from __future__ import annotations

from . import Fields, Point, Texture, cell, function, sdl, two_colors


def twin(fields: Fields) -> Texture:
    """`a`, `b`, `scale`, `offset`, `mapping`."""
    size = sdl.number(fields.number("scale", 1.0, lambda number: number > 0, "a number > 0"))
    offset = fields.vector("offset", (0.0, 0.0, 0.0))

    def value(q: Point) -> str:
        return f"abs(mod({'+'.join(cell(f'{x}*{size}+{sdl.number(start)}') for x, start in zip(q, offset))},2))"

    return function(fields, "solid", two_colors(fields), value)
