"""Twin of the shape `disk`: POV-Ray's `disc`."""

from __future__ import annotations

from . import Fields, Place, Solid, Surface, angle, axes, coincident


def twin(fields: Fields, place: Place) -> Solid:
    """No keys."""
    x, y, _ = axes(place)
    flat = coincident.disk(1.0, 0.0, 1.0)
    surface = Surface(f"sqrt({x}*{x}+{y}*{y})", angle(x, y))
    return Solid(f"disc {{ <0,0,0>, <0,0,1>, {place.length(1)}", surface, False, outline=coincident.sheet(flat.corners, flat.normal))
