"""Twin of the shape `cylinder`: POV-Ray's `cylinder`."""

from __future__ import annotations

from . import Fields, Place, Solid, coincident
from ._round import around, heights


def twin(fields: Fields, place: Place) -> Solid:
    """`radius`, `z`, `caps`."""
    radius = fields.number("radius", 1.0, lambda metres: metres > 0, "a radius > 0")
    z = heights(fields, (-1.0, 1.0))
    caps = fields.flag("caps", True)
    ends = f"{place.point((0, 0, z[0]))}, {place.point((0, 0, z[1]))}"
    body = f"cylinder {{ {ends}, {place.length(radius)}{'' if caps else ' open'}"
    return Solid(body, around(place, z, (radius, radius), caps), caps, outline=coincident.capped(z, (radius, radius), caps, True))
