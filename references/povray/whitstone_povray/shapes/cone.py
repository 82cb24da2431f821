"""Twin of the shape `cone`: POV-Ray's `cone`."""

from __future__ import annotations

from . import Fields, Place, Solid, coincident
from ._round import around, heights


def twin(fields: Fields, place: Place) -> Solid:
    """`radii`, `z`, `caps`."""
    radii = fields.vector("radii", (1.0, 0.0), 2)
    if min(radii) < 0 or max(radii) <= 0:
        fields.error("radii", "expected two radii of at least 0, not both 0")
    z = heights(fields, (0.0, 1.0))
    caps = fields.flag("caps", True)
    ends = ", ".join(f"{place.point((0, 0, height))}, {place.length(radius)}" for height, radius in zip(z, radii))
    return Solid(f"cone {{ {ends}{'' if caps else ' open'}", around(place, z, radii, caps), caps, outline=coincident.capped(z, radii, caps, False))
