"""Twin of the texture `checker`: a function of u and v. POV-Ray's own `checker` is of three dimensions, with a tolerance."""

from __future__ import annotations

from .. import sdl
from ..fields import is_number
from . import Fields, Surface, Texture


def twin(fields: Fields) -> Texture:
    """`a`, `b`, `scale`, `offset`; by texture coordinates, not by another mapping."""
    if fields.take("mapping") is not None:
        fields.unsupported("POV-Ray's twin is a function of texture coordinates only", "mapping")
    a, b = fields.color("a", 0.8), fields.color("b", 0.2)
    size = fields.take("scale", [1.0, 1.0])
    size = [float(size)] * 2 if is_number(size) else fields.vector("scale", [1.0, 1.0], 2)
    offset = fields.vector("offset", [0.0, 0.0], 2)

    def pattern(surface: Surface) -> str:
        cells = [
            f"floor(({expression})*{sdl.number(size[axis])}+{sdl.number(offset[axis])})"
            for axis, expression in enumerate((surface.u, surface.v))
        ]
        # Patterns repeat beyond 0 and 1, so neither is reached.
        odd = f"0.25+0.5*abs(mod({cells[0]}+{cells[1]},2))"
        return f"function {{ {odd} }} color_map {{ [0.5 {sdl.rgb(a)}] [0.5 {sdl.rgb(b)}] }}"

    return Texture(None, pattern)
