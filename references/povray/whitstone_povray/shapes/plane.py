"""Twin of the shape `plane`: POV-Ray's `plane`. POV-Ray sees nothing beyond 1e7 of its units, some
10 km.
"""

from __future__ import annotations

from . import Fields, Place, Solid, Surface, axes, coincident, similarity


def twin(fields: Fields, place: Place) -> Solid:
    """No keys."""
    if similarity(place.own) is None:
        fields.error("transform", "must be a similarity")
    x, y, _ = axes(place)
    return Solid("plane { <0,0,1>, 0", Surface(x, y), False, outline=coincident.sheet((), (0.0, 0.0, 1.0)))
