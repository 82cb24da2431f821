"""Twin of the texture `constant`: a colour."""

from __future__ import annotations

from ..fields import REQUIRED
from . import Fields, Texture


def twin(fields: Fields) -> Texture:
    """`value`."""
    return Texture(fields.color("value", REQUIRED))
