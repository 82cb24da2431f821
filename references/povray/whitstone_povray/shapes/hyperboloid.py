"""Twin of the shape `hyperboloid`: POV-Ray's `quadric`, clipped."""

from __future__ import annotations

import math

from . import Fields, Place, Solid
from ._round import heights, turned


def twin(fields: Fields, place: Place) -> Solid:
    """`radius`, `slope`, `z`, `caps`."""
    radius = fields.number("radius", 0.5, lambda metres: metres > 0, "a radius > 0")
    slope = fields.number("slope", 1.0, lambda ratio: ratio > 0, "a number > 0")
    z = heights(fields, (-1.0, 1.0))
    radii = tuple(math.hypot(radius, slope * height) for height in z)
    coefficients = (1, 1, -(slope**2), 0, 0, 0, 0, 0, 0, -(radius**2))
    return turned(place, z, radii, coefficients, fields.flag("caps", True))
