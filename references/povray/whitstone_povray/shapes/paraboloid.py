"""Twin of the shape `paraboloid`: POV-Ray's `quadric`, clipped."""

from __future__ import annotations

import math

from . import Fields, Place, Solid
from ._round import heights, turned


def twin(fields: Fields, place: Place) -> Solid:
    """`radius`, `z`, `caps`."""
    radius = fields.number("radius", 1.0, lambda metres: metres > 0, "a radius > 0")
    z = heights(fields, (0.0, 1.0), 0.0)
    radii = tuple(radius * math.sqrt(max(height, 0.0)) for height in z)
    return turned(place, z, radii, (1, 1, 0, 0, 0, 0, 0, 0, -(radius**2), 0), fields.flag("caps", True))
