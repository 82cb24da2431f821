"""Twin of the shape `rectangle`: POV-Ray's `polygon`."""

from __future__ import annotations

from . import Fields, Place, Solid, Surface, axes, coincident


def twin(fields: Fields, place: Place) -> Solid:
    """No keys."""
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 0)]
    x, y, _ = axes(place)
    body = f"polygon {{ {len(corners)}, {', '.join(map(place.point, corners))}"
    return Solid(body, Surface(f"({x}+1)/2", f"({y}+1)/2"), False, outline=coincident.sheet(corners[:4], (0.0, 0.0, 1.0)))
