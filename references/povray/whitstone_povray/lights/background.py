"""Twin of the light `background`: POV-Ray's `background`."""

from __future__ import annotations

from ..fields import REQUIRED
from . import Fields, Light, exposed


def twin(fields: Fields) -> Light:
    """`radiance`."""
    return Light(background=exposed(fields, fields.color("radiance", REQUIRED)))
