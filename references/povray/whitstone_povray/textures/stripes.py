"""Twin of the texture `stripes`: a function."""

from __future__ import annotations

from typing import Callable

from . import Fields, Point, Texture, cell, function, sdl, two_colors


def layers(fields: Fields, along: Callable[[Point], str]) -> Texture:
    """`a`, `b`, `scale`, `offset`, `mapping`; the colours alternate along a coordinate."""
    size = sdl.number(fields.number("scale", 1.0, lambda number: number > 0, "a number > 0"))
    offset = sdl.number(fields.number("offset", 0.0))
    return function(fields, "solid", two_colors(fields), lambda q: f"abs(mod({cell(f'{along(q)}*{size}+{offset}')},2))")


def twin(fields: Fields) -> Texture:
    """See `layers`."""
    return layers(fields, lambda q: q[0])
