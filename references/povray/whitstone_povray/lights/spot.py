"""Twin of the light `spot`: a point light in a small shell whose transparency follows the model.

POV-Ray's own spot light falls off with a cubic of the cosine, the model's linearly in the angle.
Only shadow rays see the shell, and its transparency is a function of the direction. Rays to other
lights would differ only if they passed through the shell's few square millimetres.
"""

from __future__ import annotations

from .. import sdl
from ..fields import REQUIRED, Vector
from ..transforms import cross, dot, sub, unit
from . import Fields, Light, point_source

# Radius of the shell in metres. POV-Ray ignores objects nearer to a light than 1e-3 of its units.
SHELL = 1e-3


def _image(fields: Fields, axis: Vector) -> Vector:
    """The factor on the intensity by the keys `image`, which must be a colour, and `up`."""
    up = unit(fields.vector("up", (0.0, 1.0, 0.0)))
    if not fields.has("image"):
        if fields.has("up"):
            fields.error("up", "requires `image`")
        return (1.0, 1.0, 1.0)
    across = cross(axis, up)
    if any(axis) and dot(across, across) <= 1e-24:
        fields.error("up", "must have a direction that is not parallel to the axis")
    if isinstance(fields.take("image"), (str, dict)):
        fields.unsupported("the shell around the light shows no texture, only a colour", "image")
        return (1.0, 1.0, 1.0)
    return fields.color("image", REQUIRED)


def twin(fields: Fields) -> Light:
    """`position`, `target`, `intensity`, `cutoff_angle`, `beam_width`, `falloff`, `image`, `up`."""
    scale = fields.context.setting.scale
    position, target = fields.vector("position", REQUIRED), fields.vector("target", REQUIRED)
    axis = unit(sub(target, position))
    if not any(axis):
        fields.error("target", "must differ from the position")
    cutoff = fields.number("cutoff_angle", 20.0, lambda angle: 0 < angle < 90, "a half angle between 0 and 90 degrees")
    beam = fields.number("beam_width", 0.75 * cutoff, lambda angle: 0 <= angle < cutoff, "a half angle below the cutoff")
    intensity = fields.color("intensity", REQUIRED)
    lit = tuple(i * t for i, t in zip(intensity, _image(fields, axis)))
    source = point_source(fields, position, lit) + " }"
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
