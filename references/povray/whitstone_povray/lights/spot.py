"""Twin of the light `spot`: a point light in a small shell whose transparency follows the model.

POV-Ray's own spot light falls off with a cubic of the cosine, the model's linearly in the angle.
Only shadow rays see the shell, and its transparency is a function of the direction. Rays to other
lights would differ only if they passed through the shell's few square millimetres.
"""

from __future__ import annotations

from .. import sdl
from ..fields import REQUIRED
from ..transforms import sub, unit
from . import Fields, Light, point_source

# Radius of the shell in metres. POV-Ray ignores objects nearer to a light than 1e-3 of its units.
SHELL = 1e-3


def twin(fields: Fields) -> Light:
    """`position`, `target`, `intensity`, `cutoff_angle`, `beam_width`, `falloff`."""
    scale = fields.context.setting.scale
    position, target = fields.vector("position", REQUIRED), fields.vector("target", REQUIRED)
    axis = unit(sub(target, position))
    if not any(axis):
        fields.error("target", "must differ from the position")
    cutoff = fields.number("cutoff_angle", 20.0, lambda angle: 0 < angle < 90, "a half angle between 0 and 90 degrees")
    beam = fields.number("beam_width", 0.75 * cutoff, lambda angle: 0 <= angle < cutoff, "a half angle below the cutoff")
    source = point_source(fields, position, fields.color("intensity", REQUIRED)) + " }"
    x, y, z = ("(" + name + "-" + sdl.number(scale * p) + ")" for name, p in zip("xyz", position))
    along = f"({x}*{sdl.number(axis[0])}+{y}*{sdl.number(axis[1])}+{z}*{sdl.number(axis[2])})"
    cosine = f"max(-1,min(1,{along}/sqrt({x}*{x}+{y}*{y}+{z}*{z})))"
    share = f"max(0,min(1,({sdl.number(cutoff)}-degrees(acos({cosine})))/{sdl.number(cutoff - beam)}))"
    # Patterns repeat beyond 0 and 1, so both limits are avoided.
    pigment = f"pigment {{ function {{ 0.25+0.5*{share} }} color_map {{ [0.25 rgbt <0,0,0,0>] [0.75 rgbt <0,0,0,1>] }} }}"
    shell = (
        f"sphere {{ {sdl.vector([scale * c for c in position])}, {sdl.number(scale * SHELL)} texture {{ {pigment} "
        "finish { ambient 0 diffuse 0 } } no_image no_reflection }"
    )
    return Light(source + "\n" + shell, position=position, shell=SHELL)
