"""Twin of the light `ambient`: `emission` in the finish of every material that has an ambient term.
"""

from __future__ import annotations

from ..fields import REQUIRED
from . import Fields, Light, exposed


def twin(fields: Fields) -> Light:
    """`radiance`."""
    return Light(ambient=exposed(fields, fields.color("radiance", REQUIRED)))
