"""Twin of the texture `gradient`: a function and a colour map."""

from __future__ import annotations

from typing import Any, Tuple

from ..fields import REQUIRED
from . import Fields, Point, Texture, Vector, cell, function, sdl, two_colors


def _stops(fields: Fields) -> Tuple[Tuple[float, Vector], ...]:
    if not fields.has("stops"):
        return two_colors(fields)
    for key in ("a", "b"):
        if fields.has(key):
            fields.take(key)
            fields.error(key, "cannot be given together with `stops`")
    tables: Any = fields.take("stops")
    if not isinstance(tables, list) or not 2 <= len(tables) <= 64:
        fields.error("stops", "expected 2 to 64 tables")
        return ((0.0, (0.0, 0.0, 0.0)),)
    stops = []
    for number, table in enumerate(tables):
        inner = Fields(table, f"{fields.where}.stops[{number}]", fields.context)
        place = inner.number("at", REQUIRED, lambda place: 0 <= place <= 1, "a number from 0 to 1")
        stops.append((place, inner.color("color", REQUIRED)))
        inner.close()
    if any(before[0] >= after[0] for before, after in zip(stops, stops[1:])):
        fields.error("stops", "expected positions `at` in ascending order")
    return tuple(stops)


def twin(fields: Fields) -> Texture:
    """`a`, `b` or `stops`, `scale`, `offset`, `wrap`, `mapping`."""
    size = sdl.number(fields.number("scale", 1.0, lambda number: number > 0, "a number > 0"))
    offset = sdl.number(fields.number("offset", 0.0))
    wrap = fields.choice("wrap", "repeat", ("repeat", "clamp", "mirror"))

    def value(q: Point) -> str:
        x = f"({q[0]}*{size}+{offset})"
        if wrap == "clamp":
            return f"min(1,max(0,{x}))"
        return f"max(0,{x}-{cell(x)})" if wrap == "repeat" else f"(1-abs({x}-2*floor({x}/2)-1))"

    return function(fields, "solid", _stops(fields), value)
