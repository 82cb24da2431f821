"""Twin of the light `point`: POV-Ray's own, with a fade distance near 0."""

from __future__ import annotations

from ..fields import REQUIRED
from . import Fields, Light, point_source


def twin(fields: Fields) -> Light:
    """`position`, `intensity`, `falloff`."""
    position = fields.vector("position", REQUIRED)
    return Light(point_source(fields, position, fields.color("intensity", REQUIRED)) + " }", position=position)
