"""Twin of the shape `disk`: POV-Ray's `disc`."""

from __future__ import annotations

from . import Fields, Place, Solid, Surface, angle, axes


def twin(fields: Fields, place: Place) -> Solid:
    """No keys."""
    x, y, _ = axes(place)
    return Solid(f"disc {{ <0,0,0>, <0,0,1>, {place.length(1)}", Surface(f"sqrt({x}*{x}+{y}*{y})", angle(x, y)), False)
