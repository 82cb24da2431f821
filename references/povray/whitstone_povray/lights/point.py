"""Twin of the light `point`: POV-Ray's own, with a fade distance near 0."""

from __future__ import annotations

from ..fields import REQUIRED
from . import Fields, Light, point_source


def twin(fields: Fields) -> Light:
    """`position`, `intensity`, `falloff`."""
    return Light(point_source(fields, fields.vector("position", REQUIRED), fields.color("intensity", REQUIRED)) + " }")
