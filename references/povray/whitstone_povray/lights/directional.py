"""Twin of the light `directional`: POV-Ray's `parallel` light, whose rays start on a plane far
away.
"""

from __future__ import annotations

from .. import sdl
from ..fields import REQUIRED
from ..transforms import unit
from . import Fields, Light, exposed

# In metres: objects farther away cast no shadow.
FAR = 9000.0


def twin(fields: Fields) -> Light:
    """`direction`, `irradiance`."""
    direction = unit(fields.vector("direction", REQUIRED))
    if not any(direction):
        fields.error("direction", "must not have length zero")
    far = -FAR * fields.context.setting.scale
    place = sdl.vector([far * component for component in direction])
    color = sdl.rgb(exposed(fields, fields.color("irradiance", REQUIRED)))
    return Light(f"light_source {{ {place} {color} parallel point_at <0,0,0> }}")
